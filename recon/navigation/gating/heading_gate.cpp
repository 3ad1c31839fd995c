#include "recon/navigation/gating/heading_gate.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::slam {
namespace {

// Usual deviation of D from c: the compass's deviation changes with heading, its tilt compensation
// is not perfect, and visual odometry turns a little with every step [rad].
constexpr double kUsualOff = 1.5 * kRadiansPerDegree;
constexpr double kMargin = 0.7 * kRadiansPerDegree;  // beside an anomaly this is its margin [rad]
// After a turn the deviation is another one: more by the root of the turn, and c follows quicker.
constexpr double kUsualOffTurn = 1.0 * kRadiansPerDegree;  // [rad/rad^(1/2)]
constexpr double kTurnForgets = 0.97;                      // what a step leaves of the turns before it
constexpr double kFollows = 0.02,
                 kFollowsTurn = 0.06;  // share of D - c by which c follows it, a step; [1/rad]
// Costs, in units of squared standard deviations.
constexpr double kAnomalyCost = 2;  // of the compass, at most, a second
// Of a visual link: chi-square with 6 degrees of freedom, 99.9 %; less where the compass would have had to
// turn faster than it does at half a metre a second above any wreck [rad/s].
constexpr double kFalseLinkCost = 22, kFalseJumpCost = 10;
constexpr double kFastest = 3 * kRadiansPerDegree;
// A link that contradicts the compass by more than this was found against it, by strict rules: then the
// compass has jumped, as a current that is switched on makes it [rad].
constexpr double kCertainJump = 12 * kRadiansPerDegree;
constexpr double kJumpCost = 12;
constexpr double kRestartCost = 150;  // of another reference: an anomaly of more than a minute
constexpr double kLongStep_s = 2;  // a longer step counts as one of these: readings do not repeat themselves
constexpr double kSame = 0.4 * kRadiansPerDegree;         // between constants that are the same
constexpr double kCompassStep = 0.6 * kRadiansPerDegree;  // noise of the compass between two keyframes
constexpr double kLeastJump = 1.5 * kRadiansPerDegree;  // a smaller contradiction of a link is no false link
constexpr double kLeastConfirmed = 0.02;  // of the whole turn, of which the heading is a part [rad]
static_assert(kLeastConfirmed < kLeastJump);
constexpr double kGateSigmas = 4;   // standard deviations
constexpr double kBiasWalk = 2e-6;  // of the gyro [rad/s^(3/2)]

bool bitAt(const auto& steps, std::size_t slot) {
  return (steps[slot / 64] >> (slot % 64) & 1U) != 0;
}

double compassSigma(const StepTurns& step) {
  return std::max(kCompassStep, step.compass_sigma);
}

void setBit(auto& steps, std::size_t slot, bool value) {
  const std::uint64_t bit = std::uint64_t{1} << (slot % 64);
  steps[slot / 64] = value ? steps[slot / 64] | bit : steps[slot / 64] & ~bit;
}

}  // namespace

bool worthConfirming(const SE3& T_reckoned, const SE3& T_link) {
  return T_reckoned.rotation().angularDistance(T_link.rotation()) >= kLeastConfirmed;
}

double HeadingGate::gyroSigma(const StepTurns& step) const {
  return std::sqrt(step.gyro_sigma * step.gyro_sigma + gyro_variance_ * step.seconds * step.seconds);
}

// The turn to join; the gyro's bias is estimated from links that agree with it.
HeadingGate::Joined HeadingGate::join(const StepTurns& s) {
  Joined out;
  out.turn = s.compass;
  gyro_variance_ += kBiasWalk * kBiasWalk * s.seconds;
  const double gyro = wrapAngle(s.gyro - gyro_bias_ * s.seconds), gyro_sigma = gyroSigma(s);
  out.known = s.has_visual || s.has_gyro;
  if (s.has_visual && s.has_gyro) {
    const double apart = wrapAngle(gyro - s.visual), spread = hypotenuse(gyro_sigma, s.visual_sigma);
    const auto near = [&](double turn, double sigma) {
      return std::abs(wrapAngle(turn - s.compass)) < kGateSigmas * hypotenuse(sigma, compassSigma(s));
    };
    if (std::abs(apart) <= kGateSigmas * spread) {
      out.turn = s.visual;
      const double seen = s.seconds > 0 ? gyro_variance_ * s.seconds / (spread * spread) : 0;  // the gain
      gyro_bias_ += seen * apart;
      gyro_variance_ *= 1 - seen * s.seconds;
    } else if (near(s.visual, s.visual_sigma) && !near(gyro, gyro_sigma)) {
      out.turn = s.visual;
    } else {
      out.turn = gyro;
      out.blamed = true;
    }
  } else if (s.has_visual) {
    out.turn = s.visual;
    out.alone = true;
  } else if (s.has_gyro) {
    out.turn = gyro;
  }
  return out;
}

void HeadingGate::keep(const History& h) {
  int at = -1;
  for (int i = 0; i < next_count_; ++i)
    if (std::abs(wrapAngle(next_[static_cast<std::size_t>(i)].constant - h.constant)) < kSame) at = i;
  if (at < 0 && next_count_ < kHistories)
    at = next_count_++;
  else if (at < 0) {
    const auto worst = std::max_element(next_.begin(), next_.end(),
                                        [](const History& a, const History& b) { return a.cost < b.cost; });
    if (worst->cost > h.cost) *worst = h;
    return;
  } else if (next_[static_cast<std::size_t>(at)].cost <= h.cost) {
    return;
  }
  next_[static_cast<std::size_t>(at)] = h;
}

// A history with what the compass says at the step's end, and with another reference from there on.
void HeadingGate::follow(History h, const StepTurns& step, bool jumped) {
  const std::size_t at = slot(steps_);
  setBit(h.restarted, at, jumped);
  if (step.compass_held) {
    setBit(h.rejected, at, true);
    setBit(h.biased, at, false);
    keep(h);
    return;
  }
  if (relocks_ || step.compass_jumped) h.constant = reckoned_;
  const double off = wrapAngle(reckoned_ - h.constant);
  const double usual = compassSigma(step) / kCompassStep * (kUsualOff + kUsualOffTurn * std::sqrt(turned_)),
               cost = off * off / (usual * usual);
  const bool rejected = cost > kAnomalyCost;
  setBit(h.rejected, at, rejected);
  setBit(h.biased, at, std::abs(off) > kMargin * usual / kUsualOff);
  if (rejected) {
    History restarted = h;
    setBit(restarted.rejected, at, false);
    setBit(restarted.biased, at, false);
    setBit(restarted.restarted, at, true);
    restarted.constant = reckoned_;
    restarted.cost += kRestartCost;
    keep(restarted);
  } else {
    h.constant = wrapAngle(h.constant + (kFollows + kFollowsTurn * std::min(turned_, 1.0)) * off);
  }
  h.cost += std::min(cost, kAnomalyCost) * std::min(step.seconds, kLongStep_s);
  keep(h);
}

void HeadingGate::add(const StepTurns& step) {
  const std::size_t at = slot(steps_);
  const Joined joined = join(step);
  const double contradiction = wrapAngle(joined.turn - step.compass);
  reckoned_ = wrapAngle(reckoned_ + contradiction);
  turned_ = kTurnForgets * turned_ + std::abs(joined.turn);
  relocks_ = relocks_ || (!joined.known && (step.compass_held || was_held_)) ||
             (step.compass_jumped && step.compass_held);
  const bool jump = joined.alone && !step.compass_held && !step.compass_jumped &&
                    std::abs(contradiction) >
                        std::max(kLeastJump, kGateSigmas * hypotenuse(step.visual_sigma, compassSigma(step)));
  next_count_ = 0;
  for (int i = 0; i < count_; ++i) {
    History h = histories_[static_cast<std::size_t>(i)];
    setBit(h.blamed, at, joined.blamed);
    follow(h, step, step.compass_jumped);
    if (!jump) continue;
    h.constant = wrapAngle(h.constant + contradiction);
    if (step.confirmed || std::abs(contradiction) > kCertainJump) {
      h.cost += kJumpCost;
      follow(h, step, true);
    } else {
      setBit(h.blamed, at, true);
      h.cost += std::abs(contradiction) > kFastest * step.seconds ? kFalseJumpCost : kFalseLinkCost;
      follow(h, step, false);
    }
  }
  std::swap(histories_, next_);
  count_ = next_count_;
  was_held_ = step.compass_held;
  if (!step.compass_held) relocks_ = false;
  ++steps_;
  settle();
}

// The verdicts of the cheapest history. What leaves the window is final: histories that differ there end.
void HeadingGate::settle() {
  const auto cheaper = [](const History& a, const History& b) { return a.cost < b.cost; };
  std::swap(histories_[0], *std::min_element(histories_.begin(), histories_.begin() + count_, cheaper));
  const History& best = histories_[0];
  const std::int64_t oldest = std::max<std::int64_t>(0, steps_ - kWindow);
  int kept = 1;
  for (int i = 1; i < count_; ++i) {
    const History& h = histories_[static_cast<std::size_t>(i)];
    const std::size_t at = slot(oldest);
    const bool differs =
        bitAt(h.blamed, at) != bitAt(best.blamed, at) || bitAt(h.restarted, at) != bitAt(best.restarted, at);
    if (steps_ < kWindow || !differs) histories_[static_cast<std::size_t>(kept++)] = h;
  }
  count_ = kept;
  const double least = best.cost;
  for (int i = 0; i < count_; ++i) histories_[static_cast<std::size_t>(i)].cost -= least;
  first_changed_ = steps_ - 1;
  // Rejection spreads over biased readings beside it, to either side.
  Steps anomalous = best.rejected;
  const auto spread = [&](std::int64_t step, std::int64_t beside) {
    if (bitAt(anomalous, slot(beside)) && bitAt(best.biased, slot(step))) setBit(anomalous, slot(step), true);
  };
  for (std::int64_t step = oldest + 1; step < steps_; ++step) spread(step, step - 1);
  for (std::int64_t step = steps_ - 2; step >= oldest; --step) spread(step, step + 1);
  for (std::int64_t step = steps_ - 1; step >= oldest; --step) {
    const std::size_t at = slot(step);
    Stored now;
    now.compass = !bitAt(anomalous, at);
    now.visual = !bitAt(best.blamed, at);
    now.restarts = bitAt(best.restarted, at);
    if (static_cast<const Verdict&>(now) == static_cast<const Verdict&>(verdicts_[at])) continue;
    verdicts_[at] = now;
    first_changed_ = step;
  }
}

}  // namespace fathom::slam
