#include "recon/products/rasters/sparse_cells.hpp"

#include <algorithm>

#include "recon/products/rasters/layer_patch.hpp"

namespace fathom::topside {
namespace {

constexpr std::int32_t kEdge = 64;  // of a square [cells]; a power of two
constexpr std::int32_t kShift = 6;
static_assert(1 << kShift == kEdge);

std::size_t within(std::int32_t x, std::int32_t y) {
  return static_cast<std::size_t>((x & (kEdge - 1)) * kEdge + (y & (kEdge - 1)));
}

}  // namespace

void SparseCells::set(std::int32_t x, std::int32_t y, float value) {
  std::vector<float>& square = squares_[{x >> kShift, y >> kShift}];
  if (square.empty()) square.assign(kEdge * kEdge, kNoValue);
  square[within(x, y)] = value;
  if (extent_.cells() == 0) {
    extent_ = {x, y, 1, 1};
    return;
  }
  const std::int32_t x1 = std::max(extent_.x + extent_.rows, x + 1),
                     y1 = std::max(extent_.y + extent_.columns, y + 1);
  extent_.x = std::min(extent_.x, x);
  extent_.y = std::min(extent_.y, y);
  extent_.rows = x1 - extent_.x;
  extent_.columns = y1 - extent_.y;
}

float SparseCells::get(std::int32_t x, std::int32_t y) const {
  const auto found = squares_.find({x >> kShift, y >> kShift});
  return found == squares_.end() ? kNoValue : found->second[within(x, y)];
}

CellWindow SparseCells::extent() const {
  return extent_;
}

bool SparseCells::touches(const CellWindow& window) const {
  for (std::int32_t x = window.x >> kShift; x <= (window.x + window.rows - 1) >> kShift; ++x) {
    const auto from = squares_.lower_bound({x, window.y >> kShift});
    if (from != squares_.end() && from->first.first == x &&
        from->first.second <= (window.y + window.columns - 1) >> kShift)
      return true;
  }
  return false;
}

void SparseCells::read(const CellWindow& window, float* out) const {
  for (std::int32_t row = 0; row < window.rows; ++row)
    for (std::int32_t column = 0; column < window.columns; ++column)
      out[window.at(row, column)] = get(window.x + row, window.y + column);
}

RasterSource sourceOf(const std::shared_ptr<const SparseCells>& cells) {
  RasterSource source;
  source.extent = cells->extent();
  source.cell = cells->cell();
  source.touches = [cells](const CellWindow& w) { return cells->touches(w); };
  source.fill = [cells](const CellWindow& w, void* out) { cells->read(w, static_cast<float*>(out)); };
  return source;
}

}  // namespace fathom::topside
