#include "recon/products/rasters/track_layers.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

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

namespace {

using Value = std::function<std::optional<double>(const DiveTrackPoint&)>;

// A place on the track is drawn once it is this share of the radius away from the last: enough for a smooth
// band, and a hover is not summed up thousands of times.
constexpr double kStep = 0.25;

std::shared_ptr<SparseCells> drawn(const std::vector<DiveTrackPoint>& track, double cell, double radius,
                                   const Value& value) {
  struct Sum {
    double value = 0, weight = 0;
  };
  std::map<std::pair<std::int32_t, std::int32_t>, Sum> sums;
  std::optional<Eigen::Vector2d> last;
  for (const DiveTrackPoint& point : track) {
    if (!point.T_nav_body || !(point.stage.empty() || point.stage == "survey")) continue;
    const Eigen::Vector2d place = point.T_nav_body->translation().head<2>();
    const auto known = value(point);
    if (!known || !std::isfinite(*known) || !place.allFinite() || place.cwiseAbs().maxCoeff() > 1e6) continue;
    if (last && (place - *last).norm() < kStep * radius) continue;
    last = place;
    const auto first = [&](double v) {
      return static_cast<std::int32_t>(std::ceil((v - radius) / cell - 0.5));
    };
    const auto end = [&](double v) {
      return static_cast<std::int32_t>(std::floor((v + radius) / cell - 0.5));
    };
    for (std::int32_t x = first(place.x()); x <= end(place.x()); ++x) {
      for (std::int32_t y = first(place.y()); y <= end(place.y()); ++y) {
        const double distance = (Eigen::Vector2d((x + 0.5) * cell, (y + 0.5) * cell) - place).norm() / radius;
        if (distance >= 1) continue;
        Sum& sum = sums[{x, y}];
        const double weight = 1 - distance * distance;
        sum.value += weight * *known;
        sum.weight += weight;
      }
    }
  }
  auto out = std::make_shared<SparseCells>(cell);
  for (const auto& [at, sum] : sums)
    out->set(at.first, at.second, static_cast<float>(sum.value / sum.weight));
  return out;
}

}  // namespace

std::vector<TrackLayer> trackLayers(const std::vector<DiveTrackPoint>& track, double cell, double radius) {
  std::vector<TrackLayer> out;
  const auto add = [&](const char* name, const char* title, const char* unit, const Value& value) {
    auto cells = drawn(track, cell, radius, value);
    if (cells->extent().cells() > 0) out.push_back({name, title, unit, std::move(cells)});
  };
  add("altitude", "Altitude along the track", "m", [](const DiveTrackPoint& p) { return p.altitude; });
  for (std::size_t k = 0; k < kWaterProperties; ++k) {
    const WaterPropertyInfo& info = infoOf(static_cast<WaterProperty>(k));
    add(info.name, info.title, info.unit, [k](const DiveTrackPoint& p) { return p.water[k]; });
  }
  return out;
}

}  // namespace fathom::topside
