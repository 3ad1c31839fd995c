#include "recon/topside/calibration/chart_finder.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "recon/calibration/colour_chart.hpp"

namespace fathom::topside {
namespace {

using calibration::kChartColumns;
using calibration::kChartRows;

constexpr std::size_t kFewestSquares = 9;  // of a lattice
constexpr double kMostSide = 1400;         // of the searched image [px]

struct Square {
  std::array<cv::Point2f, 4> corners;
  cv::Point2f centre;
  double side = 0;  // [px]
};
using Cell = std::pair<int, int>;
using Lattice = std::map<Cell, std::size_t>;  // number of the square in each cell

cv::Point2f mapped(const cv::Matx33d& by, double x, double y) {
  const cv::Vec3d p = by * cv::Vec3d(x, y, 1);
  return {static_cast<float>(p[0] / p[2]), static_cast<float>(p[1] / p[2])};
}

// The contour as a square; false if it is none.
bool isSquare(const std::vector<cv::Point>& contour, double most_area, Square& out) {
  constexpr double kLeastArea = 80, kSolid = 0.82, kStraight = 0.045, kSame = 0.2, kOblong = 1.9;
  const double area = cv::contourArea(contour);
  if (area < kLeastArea || area > most_area) return false;
  std::vector<cv::Point> hull, quad;
  cv::convexHull(contour, hull);
  const double hull_area = cv::contourArea(hull);
  if (area < kSolid * hull_area) return false;
  cv::approxPolyDP(hull, quad, kStraight * cv::arcLength(hull, true), true);
  if (quad.size() != 4 || std::abs(cv::contourArea(quad) - hull_area) > kSame * hull_area) return false;
  out.centre = {0, 0};
  double least = 1e9, most = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    out.corners[k] = quad[k];
    out.centre += 0.25F * out.corners[k];
    const double edge = cv::norm(quad[k] - quad[(k + 1) % 4]);
    least = std::min(least, edge), most = std::max(most, edge);
  }
  out.side = std::sqrt(hull_area);
  return most <= kOblong * least;
}

// By thresholds on each channel less its local mean over its local deviation, brighter and darker, in windows
// of three sizes.
std::vector<Square> squaresOf(const cv::Mat& bgr) {
  constexpr std::array<int, 3> kWindows = {40, 16, 7};  // parts of the image's shorter side
  constexpr std::array<double, 3> kThresholds = {-0.2, 0.15, 0.6};
  std::vector<Square> out;
  std::vector<cv::Mat> channels;
  cv::split(bgr, channels);
  const int shorter = std::min(bgr.rows, bgr.cols);
  const auto look = [&](const cv::Mat& mask) {
    std::vector<std::vector<cv::Point>> contours;
    cv::findContours(mask, contours, cv::RETR_LIST, cv::CHAIN_APPROX_SIMPLE);
    for (const auto& contour : contours) {
      Square one;
      if (!isSquare(contour, shorter * shorter / 20.0, one)) continue;
      const bool known = std::any_of(out.begin(), out.end(), [&](const Square& other) {
        return cv::norm(other.centre - one.centre) < 0.25 * one.side &&
               std::abs(other.side / one.side - 1) < 0.35;
      });
      if (!known) out.push_back(one);
    }
  };
  for (const cv::Mat& channel : channels) {
    cv::Mat values, squares, mean, deviation;
    channel.convertTo(values, CV_32F);
    for (const int parts : kWindows) {
      const cv::Size window(shorter / parts | 1, shorter / parts | 1);
      cv::blur(values, mean, window);
      cv::blur(values.mul(values), squares, window);
      cv::sqrt(cv::max(squares - mean.mul(mean), 1.0F), deviation);
      const cv::Mat local = (values - mean) / (deviation + 1);
      for (const int sign : {1, -1})
        for (const double threshold : kThresholds) {
          cv::Mat mask = sign * local > threshold;
          cv::erode(mask, mask, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
          look(mask);
        }
    }
  }
  return out;
}

// Steps of a lattice from a square to its neighbours across and down [px]; false if it has none.
bool stepsFrom(const std::vector<Square>& squares, const Square& seed, cv::Point2f& across,
               cv::Point2f& down) {
  constexpr double kLeast = 0.95, kMost = 1.7, kAside = 0.25;  // in the square's sides
  const std::vector<cv::Point2f> unit{{-0.5F, -0.5F}, {0.5F, -0.5F}, {0.5F, 0.5F}, {-0.5F, 0.5F}};
  const cv::Matx33d to_image =
      cv::getPerspectiveTransform(unit, std::vector<cv::Point2f>(seed.corners.begin(), seed.corners.end()));
  const cv::Matx33d to_unit = to_image.inv();
  double x_step = kMost, y_step = kMost;
  for (const Square& other : squares) {
    if (other.side < 0.7 * seed.side || other.side > 1.4 * seed.side ||
        cv::norm(other.centre - seed.centre) > 2.2 * seed.side)
      continue;
    const cv::Point2f p = mapped(to_unit, other.centre.x, other.centre.y);
    const double x = std::abs(p.x), y = std::abs(p.y);
    if (y < kAside && x > kLeast) x_step = std::min(x_step, x);
    if (x < kAside && y > kLeast) y_step = std::min(y_step, y);
  }
  if (x_step == kMost && y_step == kMost) return false;
  if (x_step == kMost) x_step = y_step;
  if (y_step == kMost) y_step = x_step;
  across = 0.5F * (mapped(to_image, x_step, 0) - mapped(to_image, -x_step, 0));
  down = 0.5F * (mapped(to_image, 0, y_step) - mapped(to_image, 0, -y_step));
  return true;
}

cv::Mat placeOf(const Lattice& lattice, const std::vector<Square>& squares, int method, double inlier_px) {
  std::vector<cv::Point2f> cells, centres;
  for (const auto& [cell, square] : lattice) {
    cells.emplace_back(static_cast<float>(cell.first), static_cast<float>(cell.second));
    centres.push_back(squares[square].centre);
  }
  return cv::findHomography(cells, centres, method, inlier_px);
}

bool isTwoDimensional(const Lattice& lattice) {
  const Cell first = lattice.begin()->first;
  return std::any_of(lattice.begin(), lattice.end(),
                     [&](const auto& c) { return c.first.first != first.first; }) &&
         std::any_of(lattice.begin(), lattice.end(),
                     [&](const auto& c) { return c.first.second != first.second; });
}

// The squares that continue a square's lattice, to direct neighbours first, then over gaps of one cell.
Lattice grown(const std::vector<Square>& squares, std::size_t seed) {
  constexpr int kReach = 6;  // cells
  constexpr std::array<Cell, 4> kNext = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};
  constexpr std::array<Cell, 8> kGaps = {
      {{2, 0}, {-2, 0}, {0, 2}, {0, -2}, {1, 1}, {-1, 1}, {1, -1}, {-1, -1}}};
  constexpr std::size_t kOfHomography = 6;
  Lattice out;
  cv::Point2f across, down;
  if (!stepsFrom(squares, squares[seed], across, down)) return out;
  const double near_px = 0.28 * std::min(cv::norm(across), cv::norm(down));
  std::vector<bool> used(squares.size(), false);
  out[{0, 0}] = seed;
  used[seed] = true;
  cv::Mat place;
  const auto expected = [&](const Cell& cell, const Cell& from) {
    if (!place.empty()) return mapped(place, cell.first, cell.second);
    return squares[out.at(from)].centre + across * static_cast<float>(cell.first - from.first) +
           down * static_cast<float>(cell.second - from.second);
  };
  const auto extend = [&](const auto& offsets) {
    const Lattice known = out;
    for (const auto& [from, square] : known)
      for (const Cell& offset : offsets) {
        const Cell cell{from.first + offset.first, from.second + offset.second};
        if (out.contains(cell) || std::abs(cell.first) > kReach || std::abs(cell.second) > kReach) continue;
        const cv::Point2f at = expected(cell, from);
        double best = near_px;
        std::size_t found = squares.size();
        for (std::size_t k = 0; k < squares.size(); ++k) {
          const double ratio = squares[k].side / squares[square].side, off = cv::norm(squares[k].centre - at);
          if (used[k] || ratio < 0.7 || ratio > 1.4 || off >= best) continue;
          best = off, found = k;
        }
        if (found == squares.size()) continue;
        out[cell] = found;
        used[found] = true;
      }
    return out.size() > known.size();
  };
  while (extend(kNext) || extend(kGaps))
    if (out.size() >= kOfHomography && isTwoDimensional(out)) place = placeOf(out, squares, 0, 0);
  return out;
}

// Positions and orientations of a chart on a lattice that hold most of its squares.
std::vector<ChartPlace> placesOn(const Lattice& lattice, const std::vector<Square>& squares) {
  constexpr double kInlier = 0.15, kMostSquares = 0.5;
  std::vector<ChartPlace> out;
  if (!isTwoDimensional(lattice)) return out;
  const double side = squares[lattice.begin()->second].side;
  const cv::Mat place = placeOf(lattice, squares, cv::RANSAC, kInlier * side);
  if (place.empty()) return out;
  Cell low = lattice.begin()->first, high = low;
  for (const auto& [cell, square] : lattice) {
    low = {std::min(low.first, cell.first), std::min(low.second, cell.second)};
    high = {std::max(high.first, cell.first), std::max(high.second, cell.second)};
  }
  const cv::Matx33d pixel_of_cell = place;
  for (const bool tall : {false, true}) {
    const int columns = tall ? kChartRows : kChartColumns, rows = tall ? kChartColumns : kChartRows;
    for (int x = low.first - 2; x <= high.first; ++x)
      for (int y = low.second - 2; y <= high.second; ++y) {
        const auto held = std::count_if(lattice.begin(), lattice.end(), [&](const auto& c) {
          return c.first.first >= x && c.first.first < x + columns && c.first.second >= y &&
                 c.first.second < y + rows;
        });
        if (held < static_cast<std::ptrdiff_t>(kFewestSquares) ||
            static_cast<double>(held) < kMostSquares * static_cast<double>(lattice.size()))
          continue;
        // Cell of (column, row): as they are, or a quarter turn; and each of them half a turn on.
        const cv::Matx33d cell = tall ? cv::Matx33d(0, -1, x + kChartRows - 1, 1, 0, y, 0, 0, 1)
                                      : cv::Matx33d(1, 0, x, 0, 1, y, 0, 0, 1);
        const cv::Matx33d half_turn(-1, 0, kChartColumns - 1, 0, -1, kChartRows - 1, 0, 0, 1);
        out.push_back(pixel_of_cell * cell);
        out.push_back(pixel_of_cell * cell * half_turn);
      }
  }
  return out;
}

}  // namespace

std::vector<std::vector<ChartPlace>> chartPlaces(const cv::Mat& bgr) {
  const double scale = std::min(1.0, kMostSide / std::max(bgr.cols, bgr.rows));
  cv::Mat small = bgr;
  if (scale < 1) cv::resize(bgr, small, {}, scale, scale, cv::INTER_AREA);
  const std::vector<Square> squares = squaresOf(small);
  std::vector<Lattice> lattices;
  for (std::size_t k = 0; k < squares.size(); ++k) lattices.push_back(grown(squares, k));
  std::stable_sort(lattices.begin(), lattices.end(),
                   [](const Lattice& a, const Lattice& b) { return a.size() > b.size(); });
  const cv::Matx33d to_full(1 / scale, 0, 0.5 / scale - 0.5, 0, 1 / scale, 0.5 / scale - 0.5, 0, 0, 1);
  std::vector<bool> taken(squares.size(), false);
  std::vector<std::vector<ChartPlace>> out;
  for (Lattice& lattice : lattices) {
    std::erase_if(lattice, [&](const auto& c) { return taken[c.second]; });
    if (lattice.size() < kFewestSquares) continue;
    for (const auto& [cell, square] : lattice) taken[square] = true;
    out.push_back(placesOn(lattice, squares));
    for (ChartPlace& place : out.back()) place = to_full * place;
  }
  return out;
}

}  // namespace fathom::topside
