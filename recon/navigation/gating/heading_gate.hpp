#pragma once

#include <array>
#include <cstdint>

#include "recon/geometry/se3.hpp"
#include "recon/navigation/sensors/sensor_factors.hpp"

namespace fathom::slam {

// What a step between two consecutive keyframes turned about nav's down axis, by each sensor [rad].
struct StepTurns {
  double seconds = 0;  // of the step
  double compass = 0;
  bool compass_held = false;    // at the step's end: the compass is silent
  bool compass_jumped = false;  // a jump was removed from its readings on the step: its reference is another
  double compass_sigma = 0;     // of its turn, where the dive shows more than a good compass has
  double visual = 0, visual_sigma = 0;
  bool has_visual = false;
  // The link agrees with depth, tilt and DVL in all but this turn, or with a second link.
  bool confirmed = false;
  double gyro = 0, gyro_sigma = 0;  // without that of its bias
  bool has_gyro = false;
};

// Whether a link turns so far from dead reckoning that it may be an outlier, which a second link across the
// same step can confirm (StepTurns::confirmed).
[[nodiscard]] bool worthConfirming(const SE3& T_reckoned, const SE3& T_link);

// Outlier detection of the heading: compass, visual odometry or gyro.
//
// Visual odometry (or the gyro) joined step by step gives a heading with the difference from the compass
//   D_k = sum of (visual turn - compass turn),
// which stays near a constant c without outliers. A magnetic anomaly moves D away from c and back again,
// gradually; a false visual link moves it in one step, by the amount by which that step contradicts the
// compass, and permanently. Each history of the dive is a list of rejected links; its cost is the sum of
// - min((D_k - c)^2 / s^2, kAnomalyCost) a second, for correlated error bursts of the compass;
// - kFalseLinkCost or kFalseJumpCost for each rejected link without an independent confirmation: a gyro, or
//   the other sensors, because wrong matches err in all of them and not in the turn alone;
// - kJumpCost or kRestartCost for each new reference of the compass: at a jump by a link that is confirmed or
//   larger than the error of any link, or because D stays elsewhere.
// These are the truncated least squares of Yang et al. (2020) along a chain, minimised by the Viterbi
// algorithm (Forney 1973): of histories that have come to the same c only the cheapest is followed.
//
// Verdicts on the last kWindow steps may still change; those before are final. Fixed memory, work bounded.
class HeadingGate {
 public:
  static constexpr int kWindow = 256;  // steps

  // The next step, from keyframe steps() to the one after it.
  void add(const StepTurns& step);
  [[nodiscard]] std::int64_t steps() const { return steps_; }

  struct Verdict {
    bool compass = true;    // its reading at the step's end is an inlier
    bool visual = true;     // the link is an inlier
    bool restarts = false;  // from the step's end on the compass has another reference
    bool operator==(const Verdict&) const = default;
  };
  // Of a step, counting from 0, among the last kWindow.
  [[nodiscard]] Verdict verdict(std::int64_t step) const { return verdicts_[slot(step)]; }
  // The first step with a verdict that the last add() gave or changed.
  [[nodiscard]] std::int64_t firstChanged() const { return first_changed_; }

  [[nodiscard]] double gyroBias() const { return gyro_bias_; }  // [rad/s]
  // Standard deviation of what is left of a turn by gyro once the bias is taken out [rad].
  [[nodiscard]] double gyroSigma(const StepTurns& step) const;

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive(self.steps_, self.count_, self.reckoned_, self.turned_, self.first_changed_, self.gyro_bias_,
            self.gyro_variance_, self.was_held_, self.relocks_, self.histories_, self.verdicts_);
    archive.require(self.steps_ >= 0 && self.count_ >= 1 && self.count_ <= kHistories &&
                        self.first_changed_ >= 0 && self.first_changed_ <= self.steps_,
                    "histories of the heading that cannot be");
  }

 private:
  static constexpr int kHistories = 16;
  static constexpr int kWord = 64;
  using Steps = std::array<std::uint64_t, kWindow / kWord>;  // bits, by step modulo kWindow
  struct History {
    double constant = 0;  // c [rad]
    double cost = 0;
    Steps biased{}, rejected{}, blamed{}, restarted{};

    static void exchange(auto& archive, auto& self) {
      archive(self.constant, self.cost, self.biased, self.rejected, self.blamed, self.restarted);
    }
  };
  struct Stored : Verdict {
    static void exchange(auto& archive, auto& self) { archive(self.compass, self.visual, self.restarts); }
  };
  struct Joined {         // the turn of a step, for which the compass is not asked
    double turn = 0;      // [rad]
    bool known = false;   // by visual odometry or gyro
    bool alone = false;   // the visual link is what is known, without a gyro
    bool blamed = false;  // the gyro contradicts the visual link
  };
  static std::size_t slot(std::int64_t step) { return static_cast<std::size_t>(step % kWindow); }
  [[nodiscard]] Joined join(const StepTurns& step);
  void follow(History history, const StepTurns& step, bool jumped);
  void keep(const History& history);
  void settle();

  std::array<History, kHistories> histories_{}, next_{};
  int count_ = 1, next_count_ = 0;
  std::array<Stored, kWindow> verdicts_{};
  std::int64_t steps_ = 0, first_changed_ = 0;
  double reckoned_ = 0;    // D [rad]
  double turned_ = 0;      // in the last steps, in both directions together [rad]
  bool was_held_ = false;  // the compass, at the last step's end
  bool relocks_ = false;   // no sensor measured the turn while the compass was silent
  double gyro_bias_ = 0, gyro_variance_ = kGyroBias * kGyroBias;  // [rad/s], [rad^2/s^2]
};

}  // namespace fathom::slam
