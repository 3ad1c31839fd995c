#include "recon/calibration/board_system.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "recon/geometry/flat_port.hpp"

namespace fathom::calibration {
namespace {

constexpr std::size_t kPixelIntrinsics = 4;       // the first ones
constexpr double kPixels = 1e-3, kOthers = 1e-6;  // steps [px]; [1, m, rad]

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

}  // namespace

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

double sigmaAt(const Eigen::MatrixXd& covariance, Eigen::Index p) {
  return covariance(p, p) >= 0 ? std::sqrt(covariance(p, p)) : std::numeric_limits<double>::infinity();
}

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

}  // namespace fathom::calibration
