#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "recon/geometry/se3.hpp"
#include "recon/slam/sensor_factors.hpp"

namespace fathom::slam {

// Scale and heading misalignment of the DVL against the camera, which dead reckoning carries into every step
// in the same way, estimated from steps that visual odometry measured too: a Kalman filter on
//   d_visual = (1 + s) Rz(psi) d_reckoned,   d the way of the DVL, level [m],   linear: d_visual - d = s d +
//   psi (down x d),
// x = (s, psi), constant but for a slow walk. Steps that disagree by more than the gate are left out. Where
// steps go on disagreeing to the same side, by however little, the DVL has changed (another sound speed, a
// beam that is fouled): the sum of normalised innovations with forgetting tells (a geometric moving average,
// Roberts 1959), and scale and heading are learnt anew.
class DvlCalibration {
 public:
  // `dvl_in_camera`: its place in the camera's axes [m].
  explicit DvlCalibration(const SensorNoise& noise,
                          const Eigen::Vector3d& dvl_in_camera = Eigen::Vector3d::Zero());

  // One step as dead reckoning and as visual odometry have it, T_a_b of the cameras; the covariance is that
  // of the visual one's right perturbation. False when it was outside the gate.
  bool add(const SE3& T_odom_a, const SE3& T_odom_b, const SE3& T_a_b, const Matrix6d& covariance,
           const StepQuality& quality);

  // Standard deviation of the scale by the speed of sound, beside the instrument's own [1]. Where it changes,
  // dead reckoning has begun to use another speed, and the scale is learnt anew.
  void setSoundShare(double share);

  // T_odom_b with the way from a scaled and turned as estimated.
  [[nodiscard]] SE3 corrected(const SE3& T_odom_a, const SE3& T_odom_b) const;

  [[nodiscard]] double scale() const { return state_(0); }    // s
  [[nodiscard]] double heading() const { return state_(1); }  // psi [rad]
  [[nodiscard]] const Eigen::Matrix2d& covariance() const { return covariance_; }
  // What is left of both, as a share of the way.
  [[nodiscard]] double remainingShare() const;
  [[nodiscard]] std::uint64_t used() const { return used_; }
  [[nodiscard]] std::uint64_t gated() const { return gated_; }
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.state_, self.covariance_, self.leaning_, self.sound_share_, self.used_, self.gated_,
            self.restarts_);
  }

 private:
  // Of the DVL itself, where T_to are poses of the camera.
  [[nodiscard]] Eigen::Vector3d wayOf(const SE3& T_from, const SE3& T_to) const {
    return T_to * dvl_in_camera_ - T_from * dvl_in_camera_;
  }

  SensorNoise noise_;
  Eigen::Vector3d dvl_in_camera_;
  Eigen::Vector2d state_ = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance_;
  Eigen::Vector2d leaning_ = Eigen::Vector2d::Zero();  // sum of normalised innovations, forgetting
  double sound_share_ = 0;
  std::uint64_t used_ = 0, gated_ = 0, restarts_ = 0;
};

}  // namespace fathom::slam
