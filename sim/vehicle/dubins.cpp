#include "sim/vehicle/dubins.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace fathom::sim {
namespace {

constexpr double kTwoPi = 2.0 * std::numbers::pi;

double positiveAngle(double a) {
  // Rounding must not turn a vanishing arc into a full circle.
  constexpr double kVanishing = 1e-9;  // [rad]
  const double wrapped = a - kTwoPi * std::floor(a / kTwoPi);
  return wrapped > kTwoPi - kVanishing ? 0.0 : wrapped;
}

using Lengths = std::array<double, 3>;  // arcs [rad], line [radii]

}  // namespace

// In units of the radius, from (0, 0, alpha) to (d, 0, beta); "left" is the turn of growing heading. In
// north-east with heading from north to east that is a turn to starboard.
DubinsCurve shortestDubins(const Eigen::Vector2d& from, double from_heading, const Eigen::Vector2d& to,
                           double to_heading, double radius) {
  const Eigen::Vector2d delta = (to - from) / radius;
  const double d = delta.norm();
  const double direction = d > 0 ? std::atan2(delta.y(), delta.x()) : 0.0;
  const double a = from_heading - direction, b = to_heading - direction;
  const double sa = std::sin(a), ca = std::cos(a), sb = std::sin(b), cb = std::cos(b), cab = std::cos(a - b);

  struct Word {
    std::array<int, 3> turn;  // +1 left, -1 right, 0 straight
    std::optional<Lengths> lengths;
  };
  std::array<Word, 6> words{Word{{1, 0, 1}, {}},  Word{{-1, 0, -1}, {}}, Word{{1, 0, -1}, {}},
                            Word{{-1, 0, 1}, {}}, Word{{-1, 1, -1}, {}}, Word{{1, -1, 1}, {}}};

  if (const double p2 = 2 + d * d - 2 * cab + 2 * d * (sa - sb); p2 >= 0) {
    const double t = std::atan2(cb - ca, d + sa - sb);
    words[0].lengths = Lengths{positiveAngle(t - a), std::sqrt(p2), positiveAngle(b - t)};
  }
  if (const double p2 = 2 + d * d - 2 * cab + 2 * d * (sb - sa); p2 >= 0) {
    const double t = std::atan2(ca - cb, d - sa + sb);
    words[1].lengths = Lengths{positiveAngle(a - t), std::sqrt(p2), positiveAngle(t - b)};
  }
  if (const double p2 = -2 + d * d + 2 * cab + 2 * d * (sa + sb); p2 >= 0) {
    const double p = std::sqrt(p2);
    const double t = std::atan2(-ca - cb, d + sa + sb) - std::atan2(-2.0, p);
    words[2].lengths = Lengths{positiveAngle(t - a), p, positiveAngle(t - b)};
  }
  if (const double p2 = -2 + d * d + 2 * cab - 2 * d * (sa + sb); p2 >= 0) {
    const double p = std::sqrt(p2);
    const double t = std::atan2(ca + cb, d - sa - sb) - std::atan2(2.0, p);
    words[3].lengths = Lengths{positiveAngle(a - t), p, positiveAngle(b - t)};
  }
  if (const double c = (6 - d * d + 2 * cab + 2 * d * (sa - sb)) / 8; std::abs(c) <= 1) {
    const double p = positiveAngle(kTwoPi - std::acos(c));
    const double t = positiveAngle(a - std::atan2(ca - cb, d - sa + sb) + p / 2);
    words[4].lengths = Lengths{t, p, positiveAngle(a - b - t + p)};
  }
  if (const double c = (6 - d * d + 2 * cab + 2 * d * (sb - sa)) / 8; std::abs(c) <= 1) {
    const double p = positiveAngle(kTwoPi - std::acos(c));
    const double t = positiveAngle(-a + std::atan2(-ca + cb, d + sa - sb) + p / 2);
    words[5].lengths = Lengths{t, p, positiveAngle(b - a - t + p)};
  }

  DubinsCurve best;
  double shortest = std::numeric_limits<double>::infinity();
  for (const Word& word : words) {
    if (!word.lengths) continue;
    const Lengths& l = *word.lengths;
    if (l[0] + l[1] + l[2] >= shortest) continue;
    shortest = l[0] + l[1] + l[2];
    for (std::size_t i = 0; i < 3; ++i) {
      best.curvature[i] = word.turn[i] / radius;
      best.length[i] = l[i] * radius;
    }
  }
  return best;
}

}  // namespace fathom::sim
