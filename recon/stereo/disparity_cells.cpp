#include "recon/stereo/disparity_cells.hpp"

#include <algorithm>
#include <cmath>

#include "recon/stereo/gray_pyramid.hpp"

namespace fathom::stereo {
namespace {

// Cost of a pixel of area, against a squared residual [px^2]: on a plane it gives cells of equal size, and
// the noise of semi-global matching, a tenth of a pixel, attracts no cells.
constexpr double kAreaWeight = 0.02;
// Most that a squared residual counts [px^2]: at a step in depth no cell fits, and cutting there would leave
// too few cells for relief.
constexpr double kMostSquare = 0.25;
constexpr int kRootsPerCell = 4;  // wanted cells for each one of the start

bool cheaper(double a, const DisparityCell& ca, double b, const DisparityCell& cb) {
  if (a != b) return a < b;
  return ca.y != cb.y ? ca.y > cb.y : ca.x > cb.x;  // of equals the first in reading order
}

}  // namespace

void DisparityCells::integrate(std::span<const float> disparity) {
  const std::size_t columns = index(width_) + 1;
  integral_.assign(columns * (index(height_) + 1), Moments{});
  offset_ = 0;
  double total = 0;
  std::size_t count = 0;
  for (const float d : disparity) {
    if (!std::isfinite(d)) continue;
    total += static_cast<double>(d);
    ++count;
  }
  if (count > 0) offset_ = total / static_cast<double>(count);
  for (int y = 0; y < height_; ++y) {
    Moments row{};
    for (int x = 0; x < width_; ++x) {
      const auto value = disparity[index(y) * index(width_) + index(x)];
      if (std::isfinite(value)) {
        const double u = x - 0.5 * width_, v = y - 0.5 * height_, d = static_cast<double>(value) - offset_;
        const Moments one{1, u, v, u * u, u * v, v * v, d, u * d, v * d, d * d};
        for (std::size_t k = 0; k < kMoments; ++k) row[k] += one[k];
      }
      const Moments& above = integral_[index(y) * columns + index(x) + 1];
      Moments& here = integral_[(index(y) + 1) * columns + index(x) + 1];
      for (std::size_t k = 0; k < kMoments; ++k) here[k] = above[k] + row[k];
    }
  }
}

DisparityCells::Moments DisparityCells::sum(int x, int y, int width, int height) const {
  const std::size_t columns = index(width_) + 1;
  const Moments& a = integral_[index(y) * columns + index(x)];
  const Moments& b = integral_[index(y) * columns + index(x + width)];
  const Moments& c = integral_[index(y + height) * columns + index(x)];
  const Moments& d = integral_[index(y + height) * columns + index(x + width)];
  Moments s;
  for (std::size_t k = 0; k < kMoments; ++k) s[k] = (d[k] - b[k]) - (c[k] - a[k]);
  return s;
}

DisparityCell DisparityCells::fit(int x, int y, int width, int height) const {
  const Moments s = sum(x, y, width, height);
  DisparityCell cell{x, y, width, height, static_cast<int>(std::lround(s[0])), {}, 0, 0};
  if (cell.valid == 0) return cell;
  const double n = s[0], mx = s[1] / n, my = s[2] / n, md = s[6] / n;
  const double xx = s[3] - n * mx * mx, xy = s[4] - n * mx * my, yy = s[5] - n * my * my;
  const double xd = s[7] - n * mx * md, yd = s[8] - n * my * md, dd = s[9] - n * md * md;
  double squares = dd;
  const double determinant = xx * yy - xy * xy;
  constexpr double kMinSpread = 1e-3;  // of a slope in two directions, against pixels in one line
  if (determinant > kMinSpread * xx * yy && determinant > 0) {
    const double a = (xd * yy - yd * xy) / determinant, b = (yd * xx - xd * xy) / determinant;
    squares = dd - a * xd - b * yd;
  }
  cell.centre = {mx + 0.5 * width_, my + 0.5 * height_};
  cell.mean = md + offset_;
  cell.rms = std::sqrt(std::max(squares, 0.0) / n);
  return cell;
}

void DisparityCells::offer(int x, int y, int width, int height) {
  const DisparityCell cell = fit(x, y, width, height);
  if (cell.valid == 0) return;
  if (width < 2 * kMinEdge || height < 2 * kMinEdge) {
    cells_.push_back(cell);
    return;
  }
  heap_.push_back({cell.valid * (std::min(cell.rms * cell.rms, kMostSquare) + kAreaWeight), cell});
  std::push_heap(heap_.begin(), heap_.end(), [](const Candidate& a, const Candidate& b) {
    return cheaper(a.cost, a.cell, b.cost, b.cell);
  });
}

void DisparityCells::cutWorst() {
  std::pop_heap(heap_.begin(), heap_.end(), [](const Candidate& a, const Candidate& b) {
    return cheaper(a.cost, a.cell, b.cost, b.cell);
  });
  const DisparityCell cell = heap_.back().cell;
  heap_.pop_back();
  const int left = cell.width / 2, upper = cell.height / 2;
  offer(cell.x, cell.y, left, upper);
  offer(cell.x + left, cell.y, cell.width - left, upper);
  offer(cell.x, cell.y + upper, left, cell.height - upper);
  offer(cell.x + left, cell.y + upper, cell.width - left, cell.height - upper);
}

const std::vector<DisparityCell>& DisparityCells::simplify(std::span<const float> disparity, int width,
                                                           int height, int wanted) {
  cells_.clear();
  heap_.clear();
  width_ = width;
  height_ = height;
  if (width < 1 || height < 1 || wanted < 1 || disparity.size() != index(width) * index(height))
    return cells_;
  integrate(disparity);
  const double area = static_cast<double>(width) * height;
  const int edge = std::max(2 * kMinEdge, static_cast<int>(std::sqrt(area * kRootsPerCell / wanted)));
  for (int y = 0; y < height; y += edge)
    for (int x = 0; x < width; x += edge) offer(x, y, std::min(edge, width - x), std::min(edge, height - y));
  constexpr std::size_t kGain = 3;  // cells more by one cut
  while (!heap_.empty() && heap_.size() + cells_.size() + kGain <= index(wanted)) cutWorst();
  for (const Candidate& c : heap_) cells_.push_back(c.cell);
  std::sort(cells_.begin(), cells_.end(), [](const DisparityCell& a, const DisparityCell& b) {
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  });
  return cells_;
}

}  // namespace fathom::stereo
