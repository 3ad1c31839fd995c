#include "recon/calibration/port_calibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/camera.hpp"

namespace fathom::calibration {
namespace {

constexpr std::size_t kPixelIntrinsics = 4;       // the first ones
constexpr double kPixels = 1e-3, kOthers = 1e-6;  // steps [px]; [1, m, rad]

// One number of a rig that boards determine.
struct RigParameter {
  std::function<StereoRig(const StereoRig& rig, double by)> moved;
  double step;  // of central differences
};

// Both projections of every corner of a view, (u, v) left then right, corner after corner [px].
Eigen::VectorXd projections(const StereoRig& rig, const SE3& T_left_board,
                            const std::vector<Eigen::Vector3d>& points) {
  Eigen::VectorXd out(static_cast<Eigen::Index>(4 * points.size()));
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Eigen::Vector3d in_left = T_left_board * points[k];
    out.segment<2>(static_cast<Eigen::Index>(4 * k)) = rig.left.project(in_left);
    out.segment<2>(static_cast<Eigen::Index>(4 * k + 2)) = rig.right.project(rig.T_right_left * in_left);
  }
  return out;
}

SE3 twisted(const SE3& pose, int along, double by) {
  Vector6d twist = Vector6d::Zero();
  twist(along) = by;
  return SE3::exp(twist) * pose;
}

// fx fy cx cy k1 k2 p1 p2 and perhaps k3, of the left camera, then of the right one.
std::vector<RigParameter> cameraParameters(bool k3) {
  std::vector<RigParameter> out;
  const std::size_t count = kIntrinsics.size() - (k3 ? 0 : 1);
  for (const auto side : {&StereoRig::left, &StereoRig::right})
    for (std::size_t k = 0; k < count; ++k)
      out.push_back({[side, number = kIntrinsics[k]](StereoRig rig, double by) {
                       rig.*side.*number += by;
                       return rig;
                     },
                     k < kPixelIntrinsics ? kPixels : kOthers});
  return out;
}

// The twist of T_right_left, applied on the left.
std::vector<RigParameter> poseParameters() {
  std::vector<RigParameter> out;
  for (int along = 0; along < 6; ++along)
    out.push_back({[along](StereoRig rig, double by) {
                     rig.T_right_left = twisted(rig.T_right_left, along, by);
                     return rig;
                   },
                   kOthers});
  return out;
}

// x and y of the normal and the distance, of the left port, then of the right one; both cameras have one.
std::vector<RigParameter> portParameters() {
  std::vector<RigParameter> out;
  constexpr int kDistance = 2;  // after x and y of the normal
  for (const auto side : {&StereoRig::left, &StereoRig::right})
    for (int k = 0; k <= kDistance; ++k)
      out.push_back({[side, k](StereoRig rig, double by) {
                       FlatPort port = *(rig.*side).port;
                       if (k == kDistance)
                         port.distance += by;
                       else
                         port.normal = (port.normal + by * Eigen::Vector3d::Unit(k)).normalized();
                       (rig.*side).port = std::make_shared<const FlatPort>(std::move(port));
                       return rig;
                     },
                     kOthers});
  return out;
}

// The least-squares problem of all corners of all views about a rig, the boards' own poses eliminated (Schur
// complement).
struct BoardSystem {
  Eigen::MatrixXd information;  // of the parameters, for corners of 1 px
  Eigen::VectorXd gradient;     // information^-1 gradient is Gauss-Newton's step
  double variance = 0;          // of one coordinate of a corner [px^2]

  [[nodiscard]] Eigen::MatrixXd covariance() const;
};

// `views` with poses and residuals of this rig.
BoardSystem boardSystem(const StereoRig& rig, const std::vector<CalibratedView>& views,
                        const Chessboard& board, const std::vector<RigParameter>& parameters) {
  const auto shared = static_cast<Eigen::Index>(parameters.size());
  const std::vector<Eigen::Vector3d> points = boardPoints(board);
  BoardSystem out{Eigen::MatrixXd::Zero(shared, shared), Eigen::VectorXd::Zero(shared), 0};
  std::vector<std::array<StereoRig, 2>> moved;
  for (const RigParameter& p : parameters) moved.push_back({p.moved(rig, p.step), p.moved(rig, -p.step)});
  double squares = 0, observations = 0;
  for (const CalibratedView& view : views) {
    const auto rows = static_cast<Eigen::Index>(4 * points.size());
    Eigen::MatrixXd a(rows, shared), b(rows, 6);
    Eigen::VectorXd residual(rows);
    for (Eigen::Index p = 0; p < shared; ++p) {
      const auto at = static_cast<std::size_t>(p);
      a.col(p) = (projections(moved[at][0], view.T_left_board, points) -
                  projections(moved[at][1], view.T_left_board, points)) /
                 (2 * parameters[at].step);
    }
    for (int p = 0; p < 6; ++p)
      b.col(p) = (projections(rig, twisted(view.T_left_board, p, kOthers), points) -
                  projections(rig, twisted(view.T_left_board, p, -kOthers), points)) /
                 (2 * kOthers);
    for (std::size_t k = 0; k < points.size(); ++k) {
      residual.segment<2>(static_cast<Eigen::Index>(4 * k)) = view.left_residuals[k];
      residual.segment<2>(static_cast<Eigen::Index>(4 * k + 2)) = view.right_residuals[k];
    }
    const Eigen::MatrixXd ab = a.transpose() * b;
    const auto own = (b.transpose() * b).ldlt();
    out.information += a.transpose() * a - ab * own.solve(ab.transpose());
    out.gradient += a.transpose() * residual - ab * own.solve(b.transpose() * residual);
    squares += residual.squaredNorm();
    observations += static_cast<double>(rows);
  }
  const double free = observations - static_cast<double>(shared) - 6.0 * static_cast<double>(views.size());
  constexpr double kLeastCornerError = 0.02;  // no detector is better than this [px]
  out.variance = std::max(squares / std::max(1.0, free), kLeastCornerError * kLeastCornerError);
  return out;
}

Eigen::MatrixXd BoardSystem::covariance() const {
  // Pixels and tangents differ by orders of magnitude: scaled to ones on the diagonal before it is inverted.
  const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::Index n = information.rows();
  return variance *
         (scale.asDiagonal() * scaled.ldlt().solve(Eigen::MatrixXd::Identity(n, n)) * scale.asDiagonal());
}

// Standard deviation of one parameter; infinite where it is not determined.
double sigmaAt(const Eigen::MatrixXd& covariance, Eigen::Index p) {
  return covariance(p, p) >= 0 ? std::sqrt(covariance(p, p)) : std::numeric_limits<double>::infinity();
}

// Fills translation, rotation and baseline from the covariance of poseParameters() that begins at `first`.
void setPoseSigma(const StereoRig& rig, const Eigen::MatrixXd& covariance, Eigen::Index first,
                  RigSigma& sigma) {
  for (int i = 0; i < 3; ++i) sigma.rotation(i) = sigmaAt(covariance, first + 3 + i);
  const Eigen::Vector3d t = rig.T_right_left.translation();
  // exp(rho, phi) T moves t by rho + phi x t; along t by rho alone.
  const Eigen::Vector3d along = t.normalized();
  const Eigen::Matrix3d of_translation = covariance.block<3, 3>(first, first);
  sigma.baseline = std::sqrt(std::max(0.0, along.dot(of_translation * along)));
  // The translation itself also turns with the rotation.
  Eigen::Matrix<double, 3, 6> turn;
  turn.leftCols<3>().setIdentity();
  turn.rightCols<3>() << 0, t.z(), -t.y(), -t.z(), 0, t.x(), t.y(), -t.x(), 0;
  sigma.translation =
      (turn * covariance.block<6, 6>(first, first) * turn.transpose()).diagonal().cwiseMax(0.0).cwiseSqrt();
}

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

RigSigma rigUncertainty(const StereoRig& rig, const std::vector<CalibratedView>& views,
                        const Chessboard& board, bool k3) {
  std::vector<RigParameter> parameters = cameraParameters(k3);
  const auto cameras = static_cast<Eigen::Index>(parameters.size());
  for (RigParameter& p : poseParameters()) parameters.push_back(std::move(p));
  const Eigen::MatrixXd covariance = boardSystem(rig, views, board, parameters).covariance();
  RigSigma sigma;
  for (Eigen::Index p = 0; p < cameras / 2; ++p) {
    sigma.left.*kIntrinsicSigmas[static_cast<std::size_t>(p)] = sigmaAt(covariance, p);
    sigma.right.*kIntrinsicSigmas[static_cast<std::size_t>(p)] = sigmaAt(covariance, cameras / 2 + p);
  }
  setPoseSigma(rig, covariance, cameras, sigma);
  return sigma;
}

RigCalibration calibratePorts(std::vector<BoardView> views, const Chessboard& board, const StereoRig& air,
                              const PortGlass& glass, const RigCalibrationConfig& config,
                              const std::string& source) {
  return PortCalibrator(board, config, source).run(std::move(views), air, glass);
}

}  // namespace fathom::calibration
