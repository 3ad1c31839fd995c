#pragma once

#include <Eigen/Core>
#include <Eigen/LU>

namespace fathom::surface {

// Sum of weighted squared distances to planes and points: x' A x - 2 b' x + c (Garland & Heckbert 1997).
class Quadric {
 public:
  void addPlane(const Eigen::Vector3d& unit_normal, const Eigen::Vector3d& point, double weight) {
    const double d = unit_normal.dot(point);
    a_ += weight * unit_normal * unit_normal.transpose();
    b_ += weight * d * unit_normal;
    c_ += weight * d * d;
  }
  void addPoint(const Eigen::Vector3d& point, double weight) {
    a_.diagonal().array() += weight;
    b_ += weight * point;
    c_ += weight * point.squaredNorm();
  }
  Quadric& operator+=(const Quadric& other) {
    a_ += other.a_;
    b_ += other.b_;
    c_ += other.c_;
    return *this;
  }
  [[nodiscard]] double at(const Eigen::Vector3d& x) const {
    return std::max(0.0, x.dot(a_ * x) - 2 * b_.dot(x) + c_);
  }
  // Where the sum is least; there is one such place as soon as a point was added.
  [[nodiscard]] Eigen::Vector3d minimum() const { return a_.inverse() * b_; }

 private:
  Eigen::Matrix3d a_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b_ = Eigen::Vector3d::Zero();
  double c_ = 0;
};

}  // namespace fathom::surface
