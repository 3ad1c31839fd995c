#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "recon/geometry/se3.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"

namespace fathom::slam {

// Prior of a stereo rig before a dive, as standard deviations. The relative error of its ranges is
// scale + per_metre * range; see DvlCalibration.
struct RigPrior {
  double scale = 0.004;  // of its baseline [1]
  // Between both cameras' principal points [rad], which epipolar lines do not show.
  double principal_point = 3e-4;
  // Of its turn towards the other camera before epipolar lines have been
  // looked at [rad]; 0: it does not turn.
  double turn = 0;
  // Turn of visual odometry by range errors that are curved over the image, over the path [rad/m].
  double curl = 0.01;
  // And about the principal axis, by a disparity that slopes along the baseline: 0.05 px at the image's edge.
  double spin = 5e-4;
  // And apparent tilt of level ground in the camera's axes where the disparity slopes along either axis, over
  // the range [rad/m]: 0.035 px there.
  double ground_tilt = 7e-4;
  // Of a slope or curve of the disparity over the image, at the image's edge, which neither epipolar lines
  // nor paths show [px].
  double uneven = 0;
  double baseline = 0.07;  // [m]: per_metre is an angle over this
};

// Right perturbation of a pose that cameras saw of each other by xx, xy,
// yy, w of DvlCalibration: the turn t about the middle of the ground that
// both saw, `range` away [m]; the part of t that `part` takes, in b's axes.
[[nodiscard]] Eigen::Matrix<double, 6, 4> turnedBy(const SE3& T_a_b, double range,
                                                   const Eigen::Matrix3d& part = Eigen::Matrix3d::Identity());

// Turn of a visual link before straightened(), as addTurn() adds it up.
struct VisualTurn {
  VisualTurn() = default;
  VisualTurn(const SE3& T_a_b, const Matrix6d& covariance, int rig);

  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  Eigen::Vector3d variance = Eigen::Vector3d::Zero();  // about the axes of b [rad^2]
  int rig = -1;                                        // SharedTurns::rigEpoch(); -1: no step

  static void exchange(auto& archive, auto& self) { archive(self.turn, self.variance, self.rig); }
};

// Scale and heading misalignment of the DVL against the camera, which dead reckoning carries into every step
// in the same manner, together with the range error of the rig, which all visual links share: a Kalman filter
// on steps that visual odometry measured too,
//   d_visual = (1 + b + e r) (1 + s) Rz(psi) d_reckoned + t x a,   turn_visual - turn_reckoned = t,
//   t = R_a_b^T m(p_a) - m(p_b),   m(p) = z x Q p - w p_y z + r (u, v, 0),   Q = (xx, xy; xy, yy),
// d the path of the DVL, level [m], p the middle of the ground that both saw in each camera's axes [m], z the
// principal axis, r the range [m], and a from that ground to the DVL [m]; x = (s, psi, b, e, xx, xy, yy,
// w, u, v), constant but for a slow walk. Where a rig's range error is curved over the image, as a wrong
// principal point of a lens that distorts makes it, level ground seems a bowl or a saddle, turned by z x Q
// p at a place of the image: visual odometry turns by Q as the ground passes, and goes astray by the arm
// to it. Where the disparity slopes along the baseline, squares seem sheared, and it yaws by w. Where it
// slopes at all, ground seems tilted by (u, v), which turns links as the vehicle yaws and would pass for
// Q, by which closures across lines bend a survey. Roll and pitch, which gravity holds, show Q, so that it
// is not taken for an error of ranges or of the DVL's mounting; the compass shows what of it yaws, where
// the camera looks aside. A reading of roll and pitch ends one step and begins the next: its error is
// estimated beside x, so that a line measures Q by its length and not by its steps. Closures show what yaws,
// w of a camera that looks down, by how far the steps between have turned (addTurn), and Q by what holds the
// survey that they tilt: they are often across the lines, where steps show little (setClosures). One range
// measures s + b + e r alone: the priors divide it, so that the sensor that is known better stays as it is,
// and more ranges separate them. Steps outside the gate are rejected. Where steps keep a bias to one side,
// however small, the DVL has changed (another sound speed, a fouled beam): the sum of normalised innovations
// with forgetting shows it (a geometric moving average, Roberts 1959), and its scale and heading are reset.
class DvlCalibration {
 public:
  // x, and the error of the newest reading of roll and pitch in nav's axes [rad].
  static constexpr int kStates = 12;
  using State = Eigen::Matrix<double, kStates, 1>;
  using Covariance = Eigen::Matrix<double, kStates, kStates>;

  // `dvl_in_camera`: its place in the camera's axes [m].
  explicit DvlCalibration(const SensorNoise& noise,
                          const Eigen::Vector3d& dvl_in_camera = Eigen::Vector3d::Zero(),
                          const RigPrior& rig = {});

  // One step as dead reckoning and as visual odometry have it, T_a_b of the cameras; the covariance is that
  // of the visual one's right perturbation, without the rig's range error; `range` to what it saw [m]. False
  // when it was outside the gate.
  bool add(const SE3& T_odom_a, const SE3& T_odom_b, const SE3& T_a_b, const Matrix6d& covariance,
           const StepQuality& quality, double range);

  // Links, before straightened(), have turned by `turn` about an axis against an independent measurement;
  // `by`: derivative of that turn by xx, xy, yy, w [m].
  void addTurn(double turn, double variance, const Eigen::RowVector4d& by);
  // Information of all closures about xx, xy, yy, w, which replaces that
  // given before, and that times their difference from curl().
  void setClosures(const Eigen::Matrix4d& information, const Eigen::Vector4d& sum);

  // Standard deviation of the scale by the speed of sound, beside the instrument's own [1]. Where it changes,
  // dead reckoning has begun to use another speed, and the scale is reset.
  void setSoundShare(double share);

  // T_odom_b with the path from a scaled and turned as estimated.
  [[nodiscard]] SE3 corrected(const SE3& T_odom_a, const SE3& T_odom_b) const;

  [[nodiscard]] double scale() const { return all_.state(0); }    // s
  [[nodiscard]] double heading() const { return all_.state(1); }  // psi [rad]
  // Range error of the rig: scale b [1] and e [1/m]. The users of the rig correct it.
  [[nodiscard]] Eigen::Vector2d rangeError() const { return all_.state.segment<2>(2); }
  // xx, xy, yy, w [rad/m] and their standard deviations.
  [[nodiscard]] Eigen::Vector4d curl() const { return all_.state.segment<4>(kCurl); }
  [[nodiscard]] Eigen::Vector4d curlSigma() const {
    return all_.covariance.diagonal().segment<4>(kCurl).cwiseSqrt();
  }
  [[nodiscard]] Eigen::Matrix4d curlCovariance() const { return all_.covariance.block<4, 4>(kCurl, kCurl); }
  // A pose that cameras saw of each other, without t; `range` to the ground [m]. And what is left open of its
  // length and turn, as covariance of the right perturbation of T_a_b.
  [[nodiscard]] SE3 straightened(const SE3& T_a_b, double range) const;
  [[nodiscard]] Matrix6d leftOpen(const SE3& T_a_b, double range) const;
  // Standard deviation of the range error at a range [1].
  [[nodiscard]] double rangeSigma(double range) const;
  [[nodiscard]] const Covariance& covariance() const { return all_.covariance; }
  // Standard deviation of scale and heading, as a share of the path.
  [[nodiscard]] double remainingShare() const {
    return std::sqrt(all_.covariance.diagonal().head<2>().maxCoeff());
  }
  [[nodiscard]] std::uint64_t used() const { return used_; }
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }

  // The rig was changed so that its ranges grew by (scale, per metre): Q, which changes with it, is open by
  // as much again. True where that is more than it was known to: what closures showed is void.
  bool rigChanged(const Eigen::Vector2d& growth);
  // The rig was measured for the first time, or again after a knock: the turn of one camera towards the other
  // is known to this [rad], and the range error per metre is reset.
  void resetRig(double turn_sigma);

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.steps_.state, self.steps_.covariance, self.closures_information_, self.closures_sum_,
            self.T_odom_read_, self.drift_, self.sound_share_, self.used_, self.gated_, self.restarts_);
    if constexpr (Archive::kLoading) self.join();
  }

 private:
  static constexpr int kCurl = 4, kTilt = 8, kReading = 10;

  // Of the DVL itself, where T_to are poses of the camera.
  [[nodiscard]] Eigen::Vector3d pathOf(const SE3& T_from, const SE3& T_to) const {
    return T_to * dvl_in_camera_ - T_from * dvl_in_camera_;
  }

  void beginAt(const SE3& T_odom_a);
  bool passes(const Eigen::Vector2d& normal);
  void join();

  SensorNoise noise_;
  Eigen::Vector3d dvl_in_camera_;
  RigPrior rig_;
  struct Estimate {
    State state = State::Zero();
    Covariance covariance = Covariance::Zero();
  };
  Estimate steps_, all_;  // all: with closures
  Eigen::Matrix4d closures_information_ = Eigen::Matrix4d::Zero();
  Eigen::Vector4d closures_sum_ = Eigen::Vector4d::Zero();
  SE3 T_odom_read_;                                  // the camera where the newest reading was
  Eigen::Vector2d drift_ = Eigen::Vector2d::Zero();  // sum of normalised innovations, forgetting
  double sound_share_ = 0;
  std::uint64_t used_ = 0, gated_ = 0, restarts_ = 0;
};

}  // namespace fathom::slam
