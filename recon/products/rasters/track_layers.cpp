#include "recon/products/rasters/track_layers.hpp"

#include <cmath>
#include <functional>
#include <map>

namespace fathom::topside {
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
