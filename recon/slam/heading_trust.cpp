#include "recon/slam/heading_trust.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fathom::slam {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
// How far D may stray while the compass is honest: its deviation changes with heading, its tilt compensation
// is not perfect, and visual odometry turns a little with every step [rad].
constexpr double kHonest = 1.5 * kDegree;
constexpr double kLeans = 0.7 * kDegree;  // beside an anomaly this is its skirt [rad]
// After a turn the deviation is another one: more by the root of the turn, and c follows quicker.
constexpr double kHonestTurn = 1.0 * kDegree;  // [rad/rad^(1/2)]
constexpr double kTurnForgets = 0.97;          // what a step leaves of the turns before it
constexpr double kFollows = 0.02,
                 kFollowsTurn = 0.06;  // share of D - c by which c follows it, a step; [1/rad]
// Costs, in units of squared standard deviations.
constexpr double kAnomaly = 2;  // of the compass, at most, a second
// Of a visual link: chi-square with 6 degrees of freedom, 99.9 %; less where the compass would have had to
// turn faster than it does at half a metre a second above any wreck [rad/s].
constexpr double kFalseLink = 22, kFalseLeap = 10;
constexpr double kFastest = 3 * kDegree;
// A link that contradicts the compass by more than this was found against it, by strict rules: then the
// compass has leapt, as a current that is switched on makes it [rad].
constexpr double kLeaps = 12 * kDegree;
constexpr double kLeap = 12;
constexpr double kRestart = 150;   // of another reference: an anomaly of more than a minute
constexpr double kLongStep_s = 2;  // a longer step counts as one of these: readings do not repeat themselves
constexpr double kSame = 0.4 * kDegree;         // between constants that are the same
constexpr double kCompassStep = 0.6 * kDegree;  // noise of the compass between two keyframes
constexpr double kLeastJump = 1.5 * kDegree;    // a smaller contradiction of a link is no false link
constexpr double kLeastConfirmed = 0.02;        // of the whole turn, of which the heading is a part [rad]
static_assert(kLeastConfirmed < kLeastJump);
constexpr double kGate = 4;         // standard deviations
constexpr double kBiasWalk = 2e-6;  // of the gyro [rad/s^(3/2)]

template <typename Steps>
bool has(const Steps& steps, std::size_t slot) {
  return (steps[slot / 64] >> (slot % 64) & 1U) != 0;
}

template <typename Steps>
void set(Steps& steps, std::size_t slot, bool value) {
  const std::uint64_t bit = std::uint64_t{1} << (slot % 64);
  steps[slot / 64] = value ? steps[slot / 64] | bit : steps[slot / 64] & ~bit;
}

}  // namespace

bool worthConfirming(const SE3& T_reckoned, const SE3& T_link) {
  return T_reckoned.rotation().angularDistance(T_link.rotation()) >= kLeastConfirmed;
}

double HeadingTrust::gyroSigma(const StepTurns& step) const {
  return std::sqrt(step.gyro_sigma * step.gyro_sigma + gyro_variance_ * step.seconds * step.seconds);
}

// Which turn to join; the gyro's bias is learnt from links that agree with it.
HeadingTrust::Joined HeadingTrust::join(const StepTurns& s) {
  Joined out;
  out.turn = s.compass;
  gyro_variance_ += kBiasWalk * kBiasWalk * s.seconds;
  const double gyro = wrapAngle(s.gyro - gyro_bias_ * s.seconds), gyro_sigma = gyroSigma(s);
  out.known = s.has_visual || s.has_gyro;
  if (s.has_visual && s.has_gyro) {
    const double apart = wrapAngle(gyro - s.visual), spread = std::hypot(gyro_sigma, s.visual_sigma);
    const auto near = [&](double turn, double sigma) {
      return std::abs(wrapAngle(turn - s.compass)) < kGate * std::hypot(sigma, kCompassStep);
    };
    if (std::abs(apart) <= kGate * spread) {
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

void HeadingTrust::keep(const History& h) {
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
void HeadingTrust::follow(History h, const StepTurns& step, bool leapt) {
  const std::size_t at = slot(steps_);
  set(h.restarted, at, leapt);
  if (step.compass_held) {
    set(h.distrusted, at, true);
    set(h.leaning, at, false);
    keep(h);
    return;
  }
  if (relocks_ || step.compass_leapt) h.constant = reckoned_;
  const double off = wrapAngle(reckoned_ - h.constant);
  const double honest = kHonest + kHonestTurn * std::sqrt(turned_), cost = off * off / (honest * honest);
  const bool distrusted = cost > kAnomaly;
  set(h.distrusted, at, distrusted);
  set(h.leaning, at, std::abs(off) > kLeans * honest / kHonest);
  if (distrusted) {
    History restarted = h;
    set(restarted.distrusted, at, false);
    set(restarted.leaning, at, false);
    set(restarted.restarted, at, true);
    restarted.constant = reckoned_;
    restarted.cost += kRestart;
    keep(restarted);
  } else {
    h.constant = wrapAngle(h.constant + (kFollows + kFollowsTurn * std::min(turned_, 1.0)) * off);
  }
  h.cost += std::min(cost, kAnomaly) * std::min(step.seconds, kLongStep_s);
  keep(h);
}

void HeadingTrust::add(const StepTurns& step) {
  const std::size_t at = slot(steps_);
  const Joined joined = join(step);
  const double contradiction = wrapAngle(joined.turn - step.compass);
  reckoned_ = wrapAngle(reckoned_ + contradiction);
  turned_ = kTurnForgets * turned_ + std::abs(joined.turn);
  relocks_ = relocks_ || (!joined.known && (step.compass_held || was_held_)) ||
             (step.compass_leapt && step.compass_held);
  const bool jump =
      joined.alone && !step.compass_held && !step.compass_leapt &&
      std::abs(contradiction) > std::max(kLeastJump, kGate * std::hypot(step.visual_sigma, kCompassStep));
  next_count_ = 0;
  for (int i = 0; i < count_; ++i) {
    History h = histories_[static_cast<std::size_t>(i)];
    set(h.blamed, at, joined.blamed);
    follow(h, step, step.compass_leapt);
    if (!jump) continue;
    h.constant = wrapAngle(h.constant + contradiction);
    if (step.confirmed || std::abs(contradiction) > kLeaps) {
      h.cost += kLeap;
      follow(h, step, true);
    } else {
      set(h.blamed, at, true);
      h.cost += std::abs(contradiction) > kFastest * step.seconds ? kFalseLeap : kFalseLink;
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
void HeadingTrust::settle() {
  const auto cheaper = [](const History& a, const History& b) { return a.cost < b.cost; };
  std::swap(histories_[0], *std::min_element(histories_.begin(), histories_.begin() + count_, cheaper));
  const History& best = histories_[0];
  const std::int64_t oldest = std::max<std::int64_t>(0, steps_ - kWindow);
  int kept = 1;
  for (int i = 1; i < count_; ++i) {
    const History& h = histories_[static_cast<std::size_t>(i)];
    const std::size_t at = slot(oldest);
    const bool differs =
        has(h.blamed, at) != has(best.blamed, at) || has(h.restarted, at) != has(best.restarted, at);
    if (steps_ < kWindow || !differs) histories_[static_cast<std::size_t>(kept++)] = h;
  }
  count_ = kept;
  const double least = best.cost;
  for (int i = 0; i < count_; ++i) histories_[static_cast<std::size_t>(i)].cost -= least;
  first_changed_ = steps_ - 1;
  // Distrust spreads over what leans beside it, to either side.
  Steps anomalous = best.distrusted;
  const auto spread = [&](std::int64_t step, std::int64_t beside) {
    if (has(anomalous, slot(beside)) && has(best.leaning, slot(step))) set(anomalous, slot(step), true);
  };
  for (std::int64_t step = oldest + 1; step < steps_; ++step) spread(step, step - 1);
  for (std::int64_t step = steps_ - 2; step >= oldest; --step) spread(step, step + 1);
  for (std::int64_t step = steps_ - 1; step >= oldest; --step) {
    const std::size_t at = slot(step);
    Stored now;
    now.compass = !has(anomalous, at);
    now.visual = !has(best.blamed, at);
    now.restarts = has(best.restarted, at);
    if (static_cast<const Verdict&>(now) == static_cast<const Verdict&>(verdicts_[at])) continue;
    verdicts_[at] = now;
    first_changed_ = step;
  }
}

}  // namespace fathom::slam
