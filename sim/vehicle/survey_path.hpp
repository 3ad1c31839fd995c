#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace fathom::sim {

// The shortest curve of bounded curvature between two poses in the plane (Dubins 1957; the closed forms of
// Shkel and Lumelsky 2001): three pieces, each an arc of `radius` to port or starboard or a straight line.
struct DubinsCurve {
  std::array<double, 3> curvature{};  // [1/m], positive to starboard (clockwise in north-east)
  std::array<double, 3> length{};     // [m]
  [[nodiscard]] double total() const { return length[0] + length[1] + length[2]; }
};
[[nodiscard]] DubinsCurve shortestDubins(const Eigen::Vector2d& from, double from_heading,
                                         const Eigen::Vector2d& to, double to_heading, double radius);

// A survey over a rectangle: parallel lines, then cross lines at right angles to them.
struct SurveyPlan {
  double north = 0, east = 0;  // centre of the rectangle in nav [m]
  double heading = 0;          // of the first line [rad]
  int lines = 3;               // parallel lines
  double line_length = 8;      // [m]
  double line_spacing = 1.2;   // [m]
  int cross_lines = 1;         // at right angles, spread evenly over the lines' length
  double overrun = 0.5;        // by which a cross line reaches beyond the outermost lines [m]
  double climb_per_line = 0;   // altitude of each line above that of the one before, up a wall [m]
};

struct SurveyLine {
  Eigen::Vector2d from, to;  // north, east [m]
  double rise = 0;           // altitude beyond the vehicle's usual one [m]
};
// The lines in the order in which they are flown, each joined to the next by its nearer end.
[[nodiscard]] std::vector<SurveyLine> surveyLines(const SurveyPlan& plan);

// The plan as one curve by arc length: straight lines joined by the shortest curves of bounded curvature
// (Dubins 1957). Heading is continuous; curvature is 0 on lines and +-1/turn_radius in turns.
class SurveyPath {
 public:
  // `turn_radius` [m], positive. Throws std::invalid_argument without lines.
  SurveyPath(const std::vector<SurveyLine>& lines, double turn_radius);

  struct Point {
    Eigen::Vector2d position;  // north, east [m]
    double heading = 0;        // of the tangent, not wrapped [rad]
    bool turning = false;
    double rise = 0;  // of this line, or of the one that the turn leads to [m]
  };
  [[nodiscard]] Point at(double arc_length) const;
  [[nodiscard]] double length() const { return length_; }  // [m]
  // From `arc_length` to the start of the next turn: 0 within a turn, a large number when no turn follows
  // [m].
  [[nodiscard]] double distanceToTurn(double arc_length) const;

 private:
  struct Piece {
    Eigen::Vector2d start;
    double heading = 0;    // at its start [rad]
    double curvature = 0;  // positive turns to starboard [1/m]
    double begin = 0;      // arc length at its start [m]
    double length = 0;     // [m]
    double rise = 0;       // [m]
  };
  void append(double curvature, double length, double rise);
  [[nodiscard]] const Piece& pieceAt(double arc_length) const;

  std::vector<Piece> pieces_;
  Eigen::Vector2d end_;
  double end_heading_ = 0;
  double length_ = 0;
};

}  // namespace fathom::sim
