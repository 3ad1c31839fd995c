#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <limits>

#include "recon/calibration/rig_calibration.hpp"

namespace fathom::calibration {
namespace {

constexpr std::array<double Camera::*, 9> kIntrinsics{&Camera::fx, &Camera::fy, &Camera::cx,
                                                      &Camera::cy, &Camera::k1, &Camera::k2,
                                                      &Camera::p1, &Camera::p2, &Camera::k3};
constexpr std::array<double CameraSigma::*, 9> kSigmas{&CameraSigma::fx, &CameraSigma::fy, &CameraSigma::cx,
                                                       &CameraSigma::cy, &CameraSigma::k1, &CameraSigma::k2,
                                                       &CameraSigma::p1, &CameraSigma::p2, &CameraSigma::k3};

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

}  // namespace

RigSigma rigUncertainty(const StereoRig& rig, const std::vector<CalibratedView>& views,
                        const Chessboard& board, bool k3) {
  // Shared parameters: intrinsics left, intrinsics right, twist of T_right_left (applied on the left). A
  // view's own: the twist of its board. The views' blocks are eliminated (Schur complement), so the inverse
  // of what is left is the covariance of the shared ones.
  const int per_camera = k3 ? 9 : 8;
  const int shared = 2 * per_camera + 6;
  const std::vector<Eigen::Vector3d> points = boardPoints(board);
  const auto moved = [&](int parameter, double step) {
    StereoRig out = rig;
    if (parameter < 2 * per_camera) {
      Camera& camera = parameter < per_camera ? out.left : out.right;
      camera.*kIntrinsics[static_cast<std::size_t>(parameter % per_camera)] += step;
    } else {
      Vector6d twist = Vector6d::Zero();
      twist(parameter - 2 * per_camera) = step;
      out.T_right_left = SE3::exp(twist) * rig.T_right_left;
    }
    return out;
  };
  const auto stepOf = [&](int parameter) {
    constexpr double kPixels = 1e-3, kOthers = 1e-6;  // [px]; [1, m, rad]
    return parameter < 2 * per_camera && parameter % per_camera < 4 ? kPixels : kOthers;
  };

  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(shared, shared);
  double squares = 0;
  Eigen::Index observations = 0;
  for (const CalibratedView& view : views) {
    const auto rows = static_cast<Eigen::Index>(4 * points.size());
    Eigen::MatrixXd a(rows, shared), b(rows, 6);
    for (int p = 0; p < shared; ++p) {
      const double h = stepOf(p);
      a.col(p) = (projections(moved(p, h), view.T_left_board, points) -
                  projections(moved(p, -h), view.T_left_board, points)) /
                 (2 * h);
    }
    for (int p = 0; p < 6; ++p) {
      constexpr double kStep = 1e-6;  // [m, rad]
      Vector6d twist = Vector6d::Zero();
      twist(p) = kStep;
      b.col(p) = (projections(rig, SE3::exp(twist) * view.T_left_board, points) -
                  projections(rig, SE3::exp(-twist) * view.T_left_board, points)) /
                 (2 * kStep);
    }
    const Eigen::MatrixXd ab = a.transpose() * b;
    information += a.transpose() * a - ab * (b.transpose() * b).ldlt().solve(ab.transpose());
    for (const auto* residuals : {&view.left_residuals, &view.right_residuals})
      for (const auto& r : *residuals) squares += r.squaredNorm();
    observations += rows;
  }
  const auto free = static_cast<double>(observations) - shared - 6.0 * static_cast<double>(views.size());
  constexpr double kLeastCornerError = 0.02;  // nobody finds corners better than this [px]
  const double variance =                     // of one coordinate [px^2]
      std::max(squares / std::max(1.0, free), kLeastCornerError * kLeastCornerError);

  // Pixels and tangents differ by orders of magnitude: scaled to ones on the diagonal before it is inverted.
  const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::MatrixXd covariance =
      variance * (scale.asDiagonal() * scaled.ldlt().solve(Eigen::MatrixXd::Identity(shared, shared)) *
                  scale.asDiagonal());
  const auto sigmaAt = [&](int p) {  // a singular matrix: not determined at all
    return covariance(p, p) >= 0 ? std::sqrt(covariance(p, p)) : std::numeric_limits<double>::infinity();
  };

  RigSigma sigma;
  for (int p = 0; p < per_camera; ++p) {
    sigma.left.*kSigmas[static_cast<std::size_t>(p)] = sigmaAt(p);
    sigma.right.*kSigmas[static_cast<std::size_t>(p)] = sigmaAt(per_camera + p);
  }
  for (int i = 0; i < 3; ++i) {
    sigma.translation(i) = sigmaAt(2 * per_camera + i);
    sigma.rotation(i) = sigmaAt(2 * per_camera + 3 + i);
  }
  // exp(rho, phi) T moves t by rho + phi x t; along t only rho counts.
  const Eigen::Vector3d along = rig.T_right_left.translation().normalized();
  const Eigen::Matrix3d of_translation = covariance.block<3, 3>(2 * per_camera, 2 * per_camera);
  sigma.baseline = std::sqrt(std::max(0.0, along.dot(of_translation * along)));
  // The translation itself also turns with the rotation.
  Eigen::Matrix<double, 3, 6> turn;
  turn.leftCols<3>().setIdentity();
  const Eigen::Vector3d t = rig.T_right_left.translation();
  turn.rightCols<3>() << 0, t.z(), -t.y(), -t.z(), 0, t.x(), t.y(), -t.x(), 0;
  const Eigen::Matrix3d translation =
      turn * covariance.block<6, 6>(2 * per_camera, 2 * per_camera) * turn.transpose();
  sigma.translation = translation.diagonal().cwiseMax(0.0).cwiseSqrt();
  return sigma;
}

}  // namespace fathom::calibration
