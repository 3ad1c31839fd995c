#include "recon/calibration/port_calibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/calibration/board_system.hpp"
#include "recon/geometry/flat_port.hpp"

namespace fathom::calibration {
namespace {

constexpr double kStraight = 0.05;       // prior standard deviation of a normal's x and y
constexpr double kFirstDistance = 0.02;  // initial distance of the search [m]
constexpr double kMostOpen = 0.02;       // largest standard deviation of a distance that is a result [m]
constexpr Eigen::Index kPort = 3;        // parameters of a port

class PortCalibrator {
 public:
  PortCalibrator(const Chessboard& board, const RigCalibrationConfig& config, const std::string& source)
      : config_(config), source_(source), board_(board), parameters_(portParameters()) {
    for (RigParameter& p : poseParameters()) parameters_.push_back(std::move(p));
  }

  RigCalibration run(std::vector<BoardView> views, const StereoRig& air, const PortGlass& glass) {
    out_.rig = air;
    for (Camera* camera : {&out_.rig.left, &out_.rig.right})
      *camera = behindPort({.air = *camera,
                            .distance = kFirstDistance,
                            .glass = glass.thickness,
                            .glass_index = glass.index,
                            .water_index = glass.water});
    const std::vector<bool> agrees = alignBoards(out_.rig.left, out_.rig.right, board_, views);
    for (std::size_t v = 0; v < views.size(); ++v) {
      if (agrees[v])
        out_.views.push_back(viewOf(views[v]));
      else
        out_.dropped.push_back({views[v].name, kNotOneMoment});
    }
    while (true) {
      if (static_cast<int>(out_.views.size()) < config_.min_views)
        throw InputError(source_, "",
                         std::to_string(out_.views.size()) + " usable pairs of the board, at least " +
                             std::to_string(config_.min_views) +
                             " are needed; take more, near and far, tilted and all over the image");
      solve();
      const auto gross = grossView(out_.views, config_);
      if (!gross) break;
      out_.dropped.push_back({out_.views[gross->index].name, gross->reason});
      out_.views.erase(out_.views.begin() + static_cast<std::ptrdiff_t>(gross->index));
    }
    setSigma();
    return std::move(out_);
  }

 private:
  void fitPoses() {
    for (CalibratedView& view : out_.views) fitPose(out_.rig, board_, view);
    measure(out_);
  }

  // Normal equations with the prior of the ports' normals.
  [[nodiscard]] BoardSystem system() const {
    BoardSystem s = boardSystem(out_.rig, out_.views, board_, parameters_);
    const double weight = s.variance / (kStraight * kStraight);
    Eigen::Index at = 0;
    for (const Camera* camera : {&out_.rig.left, &out_.rig.right}) {
      for (Eigen::Index k = 0; k < 2; ++k) {
        s.information(at + k, at + k) += weight;
        s.gradient(at + k) -= weight * camera->port->normal(k);
      }
      at += kPort;
    }
    return s;
  }

  // Gauss-Newton by hand: boardSystem() gives the normal equations and, with them, the covariance of the
  // result.
  void solve() {
    constexpr int kMaxSteps = 30;
    constexpr double kEnough = 1e-7;  // of a step [1, m, rad]
    fitPoses();
    for (int i = 0; i < kMaxSteps; ++i) {
      const BoardSystem s = system();
      const Eigen::VectorXd scale = s.information.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
      const Eigen::MatrixXd scaled = scale.asDiagonal() * s.information * scale.asDiagonal();
      Eigen::VectorXd step = scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * s.gradient);
      // Keeps each port's distance from the camera's centre at least zero.
      for (const auto& [at, camera] :
           {std::pair{kPort - 1, &out_.rig.left}, {2 * kPort - 1, &out_.rig.right}})
        step(at) = std::max(step(at), -camera->port->distance);
      for (std::size_t p = 0; p < parameters_.size(); ++p)
        out_.rig = parameters_[p].moved(out_.rig, step(static_cast<Eigen::Index>(p)));
      for (Camera* camera : {&out_.rig.left, &out_.rig.right}) *camera = behindPort(*camera->port);
      fitPoses();
      if (step.cwiseAbs().maxCoeff() < kEnough) break;
    }
  }

  void setSigma() {
    const Eigen::MatrixXd covariance = system().covariance();
    setPoseSigma(out_.rig, covariance, 2 * kPort, out_.sigma);
    Eigen::Index at = 0;
    for (PortSigma* port : {&out_.sigma.left_port, &out_.sigma.right_port}) {
      port->normal = {sigmaAt(covariance, at), sigmaAt(covariance, at + 1)};
      port->distance = sigmaAt(covariance, at + 2);
      if (!(port->distance < kMostOpen))
        throw InputError(
            source_, at == 0 ? "left" : "right",
            formatted("the views leave the port's distance open (± %.0f mm); show the board near "
                      "and far, in the corners of the image",
                      1e3 * port->distance));
      at += kPort;
    }
  }

  RigCalibrationConfig config_;
  std::string source_;
  Chessboard board_;
  std::vector<RigParameter> parameters_;
  RigCalibration out_;
};

}  // namespace

RigCalibration calibratePorts(std::vector<BoardView> views, const Chessboard& board, const StereoRig& air,
                              const PortGlass& glass, const RigCalibrationConfig& config,
                              const std::string& source) {
  return PortCalibrator(board, config, source).run(std::move(views), air, glass);
}

}  // namespace fathom::calibration
