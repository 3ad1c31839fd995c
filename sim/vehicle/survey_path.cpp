#include "sim/vehicle/survey_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>

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

constexpr double kShortestPiece = 1e-9;  // shorter pieces are rounding [m]

// Flies `line` from the end that is nearer to `position`.
SurveyLine fromNearerEnd(const SurveyLine& line, const Eigen::Vector2d& position) {
  const bool swap = (line.to - position).norm() < (line.from - position).norm();
  return swap ? SurveyLine{line.to, line.from, line.rise} : line;
}

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

std::vector<SurveyLine> surveyLines(const SurveyPlan& plan) {
  const Eigen::Vector2d centre(plan.north, plan.east);
  const Eigen::Vector2d along(std::cos(plan.heading), std::sin(plan.heading));
  const Eigen::Vector2d across(-along.y(), along.x());
  const double half_length = 0.5 * plan.line_length;
  const double half_width = 0.5 * plan.line_spacing * (plan.lines - 1);

  std::vector<SurveyLine> lines;
  for (int i = 0; i < plan.lines; ++i) {
    const Eigen::Vector2d middle = centre + across * (i * plan.line_spacing - half_width);
    const double sign = i % 2 == 0 ? 1.0 : -1.0;
    lines.push_back(
        {middle - sign * half_length * along, middle + sign * half_length * along, i * plan.climb_per_line});
  }
  // Cross lines, the one nearest to the end of the last line first.
  const bool ends_ahead = plan.lines % 2 == 1;
  for (int i = 0; i < plan.cross_lines; ++i) {
    const double fraction = (i + 1.0) / (plan.cross_lines + 1.0);
    const double place = (ends_ahead ? 1.0 - fraction : fraction) * plan.line_length - half_length;
    const Eigen::Vector2d reach = (half_width + plan.overrun) * across;
    const SurveyLine line{centre + place * along + reach, centre + place * along - reach,
                          (plan.lines + i) * plan.climb_per_line};
    lines.push_back(lines.empty() ? line : fromNearerEnd(line, lines.back().to));
  }
  return lines;
}

SurveyPath::SurveyPath(const std::vector<SurveyLine>& lines, double turn_radius) {
  if (lines.empty()) throw std::invalid_argument("a survey path needs at least one line");
  if (!(turn_radius > 0)) throw std::invalid_argument("the turn radius must be positive");
  end_ = lines.front().from;
  const auto headingOf = [](const SurveyLine& l) {
    const Eigen::Vector2d v = l.to - l.from;
    return std::atan2(v.y(), v.x());
  };
  end_heading_ = headingOf(lines.front());
  for (const SurveyLine& line : lines) {
    const DubinsCurve turn = shortestDubins(end_, end_heading_, line.from, headingOf(line), turn_radius);
    for (std::size_t i = 0; i < 3; ++i) append(turn.curvature[i], turn.length[i], line.rise);
    append(0.0, (line.to - line.from).norm(), line.rise);
  }
}

void SurveyPath::append(double curvature, double length, double rise) {
  if (length < kShortestPiece) return;
  pieces_.push_back({end_, end_heading_, curvature, length_, length, rise});
  length_ += length;
  const Point end = at(length_);
  end_ = end.position;
  end_heading_ = end.heading;
}

const SurveyPath::Piece& SurveyPath::pieceAt(double arc_length) const {
  const auto after = std::upper_bound(pieces_.begin(), pieces_.end(), arc_length,
                                      [](double s, const Piece& piece) { return s < piece.begin; });
  return after == pieces_.begin() ? pieces_.front() : *(after - 1);
}

SurveyPath::Point SurveyPath::at(double arc_length) const {
  const double s = std::clamp(arc_length, 0.0, length_);
  const Piece& piece = pieceAt(s);
  const double along = s - piece.begin;
  const double heading = piece.heading + piece.curvature * along;
  Point point;
  point.heading = heading;
  point.turning = piece.curvature != 0.0;
  point.rise = piece.rise;
  if (point.turning) {
    point.position = piece.start + Eigen::Vector2d(std::sin(heading) - std::sin(piece.heading),
                                                   std::cos(piece.heading) - std::cos(heading)) /
                                       piece.curvature;
  } else {
    point.position = piece.start + along * Eigen::Vector2d(std::cos(heading), std::sin(heading));
  }
  return point;
}

double SurveyPath::distanceToTurn(double arc_length) const {
  for (const Piece& piece : pieces_) {
    if (piece.curvature == 0.0 || piece.begin + piece.length <= arc_length) continue;
    return std::max(0.0, piece.begin - arc_length);
  }
  return std::numeric_limits<double>::max();
}

}  // namespace fathom::sim
