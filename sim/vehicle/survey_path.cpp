#include "sim/vehicle/survey_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "sim/vehicle/dubins.hpp"

namespace fathom::sim {
namespace {

constexpr double kShortestPiece = 1e-9;  // shorter pieces are rounding [m]

// Flies `line` from the end that is nearer to `position`.
SurveyLine fromNearerEnd(const SurveyLine& line, const Eigen::Vector2d& position) {
  const bool swap = (line.to - position).norm() < (line.from - position).norm();
  return swap ? SurveyLine{line.to, line.from, line.rise} : line;
}

}  // namespace

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
