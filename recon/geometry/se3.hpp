#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace fathom {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Rigid motion. `T_a_b` maps points of frame b into frame a and is the pose of b in a: p_a = R p_b + t.
class SE3 {
 public:
  SE3() : rotation_(Eigen::Quaterniond::Identity()), translation_(Eigen::Vector3d::Zero()) {}
  SE3(const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation) {}
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : SE3(Eigen::Quaterniond(rotation), translation) {}

  // R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad: the Euler angles of the ACFR pose files and of
  // mission.toml.
  static SE3 fromEuler(double roll, double pitch, double yaw, const Eigen::Vector3d& translation);
  // (roll, pitch, yaw) in rad; pitch in [-pi/2, pi/2].
  [[nodiscard]] Eigen::Vector3d euler() const;

  // Exponential of the twist (rho, phi), translation first [m, rad]; and its inverse, |phi| <= pi.
  static SE3 exp(const Vector6d& twist);
  [[nodiscard]] Vector6d log() const;

  [[nodiscard]] SE3 inverse() const;
  SE3 operator*(const SE3& other) const {
    return {rotation_ * other.rotation_, rotation_ * other.translation_ + translation_};
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return rotation_ * point + translation_; }

  [[nodiscard]] const Eigen::Quaterniond& rotation() const { return rotation_; }
  [[nodiscard]] const Eigen::Vector3d& translation() const { return translation_; }
  [[nodiscard]] Eigen::Matrix3d matrix3() const { return rotation_.toRotationMatrix(); }

  // For saved state (state_values.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive(self.rotation_, self.translation_);
    archive.require(isNear1(self.rotation_.squaredNorm()), "a rotation is none");
  }

 private:
  static bool isNear1(double squared_norm) { return squared_norm > 0.999 && squared_norm < 1.001; }

  Eigen::Quaterniond rotation_;
  Eigen::Vector3d translation_;
};

// Pose on the geodesic from a (s = 0) to b (s = 1): slerp of rotation, linear in translation.
[[nodiscard]] SE3 interpolate(const SE3& a, const SE3& b, double s);

// Angle in (-pi, pi].
[[nodiscard]] double wrapAngle(double radians);

// The matrix of a cross product: crossMatrix(v) u = v x u.
[[nodiscard]] inline Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// The rotation nearest to a matrix that a file gives with few decimals (polar decomposition); none where an
// element of R^T R - I is over 1e-3, or R mirrors.
[[nodiscard]] std::optional<Eigen::Matrix3d> nearestRotation(const Eigen::Matrix3d& r);

// The rigid motion, as a matrix of homogeneous coordinates, that takes points `from` nearest to their
// counterparts `to`, a column each (Umeyama 1991); `scaled`: with the best scale besides.
[[nodiscard]] Eigen::Matrix4d rigidAlignment(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to,
                                             bool scaled = false);

}  // namespace fathom
