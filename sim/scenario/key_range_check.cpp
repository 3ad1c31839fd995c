#include "sim/scenario/key_range_check.hpp"

#include <stdexcept>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

void requireSetting(bool good, const char* table, const char* what) {
  if (!good) throw std::invalid_argument(std::string(table) + ": " + what);
}

void KeyRangeCheck::enter(const char* table, const char*) {
  tables_.emplace_back(table);
}
void KeyRangeCheck::leave() {
  tables_.pop_back();
}
std::size_t KeyRangeCheck::beginList(const char* key, std::size_t count, const char*) {
  tables_.emplace_back(key);
  return count;
}

void KeyRangeCheck::requireRange(bool good, const char* key, double low, double high) const {
  if (good) return;
  std::string name;
  for (const std::string& table : tables_) name += table + ".";
  throw std::invalid_argument(name + key + " must be " + formatted("%g to %g", low, high));
}

void KeyRangeCheck::number(const char* key, double& value, const char*, double low, double high,
                           const char*) {
  requireRange(value >= low && value <= high, key, low, high);
}
void KeyRangeCheck::angle(const char* key, double& value, const char*, double low_deg, double high_deg,
                          const char*) {
  constexpr double kRounded = 1e-9;  // degrees in radians and back
  const double in_degrees = value / degreesToRadians(1);
  requireRange(in_degrees >= low_deg - kRounded && in_degrees <= high_deg + kRounded, key, low_deg, high_deg);
}
void KeyRangeCheck::integer(const char* key, std::int64_t& value, const char*, std::int64_t low,
                            std::int64_t high, const char*) {
  requireRange(value >= low && value <= high, key, static_cast<double>(low), static_cast<double>(high));
}
void KeyRangeCheck::choice(const char* key, std::size_t& value, std::span<const char* const> names,
                           const char*) {
  requireRange(value < names.size(), key, 0, static_cast<double>(names.size()) - 1);
}
void KeyRangeCheck::numbers(const char* key, std::span<double> values, const char*, double low, double high,
                            const char*) {
  for (const double value : values) requireRange(value >= low && value <= high, key, low, high);
}
void KeyRangeCheck::integers(const char* key, std::vector<int>& values, int low, int high, const char*) {
  for (const int value : values) requireRange(value >= low && value <= high, key, low, high);
}

void validate(const OpticsConfig& config) {
  const auto require = [](bool good, const char* what) { requireSetting(good, "optics", what); };
  OpticsConfig walked = config;
  KeyRangeCheck check;
  visitOptics(check, walked);
  require(!config.strobes.empty() && walked.strobes.size() == config.strobes.size(),
          "there must be 1 to 8 strobes");
  for (const StrobeConfig& s : config.strobes)
    require(s.direction_body.norm() > 1e-6, "a strobe's direction must not be zero");
  for (const PixelFormat format : {config.sensor.left_format, config.sensor.right_format})
    require(format == PixelFormat::kMono || format == PixelFormat::kBayerRggb,
            "sensor formats are mono or Bayer RGGB");
  require(config.sensor.bits == 8 || config.sensor.bits == 12, "sensor.bits must be 8 or 12");
  require(config.edge_samples == 1 || config.edge_samples == 4 || config.edge_samples == 8,
          "edge_samples must be 1, 4 or 8");
}

void validate(const TerrainConfig& c) {
  const auto require = [](bool good, const char* what) { requireSetting(good, "terrain", what); };
  TerrainConfig walked = c;
  KeyRangeCheck check;
  visitTerrain(check, walked);
  require(walked.ledges.size() == c.ledges.size() && walked.placed.size() == c.placed.size(),
          "there are at most 20 ledges and 100 placed things");
  if (c.kind == TerrainKind::kMesh) {
    require(!c.mesh_file.empty(), "mesh_file must be given for a mesh");
    return;
  }
  constexpr double kMaxVertices = 40e6;  // about 2 GB
  require(c.size_north_m * c.size_east_m / (c.grid_spacing_m * c.grid_spacing_m) <= kMaxVertices,
          "size over grid_spacing_m gives more than 40 million vertices; widen the spacing");
  require(c.size_north_m / c.grid_spacing_m < 30000 && c.size_east_m / c.grid_spacing_m < 30000,
          "size over grid_spacing_m gives more than 30000 vertices a side; widen the spacing");
  require(c.rubble.min_size_m <= c.rubble.max_size_m, "rubble needs min_size_m <= max_size_m");
  require(c.boulders.min_size_m <= c.boulders.max_size_m, "boulders need min_size_m <= max_size_m");
  require(c.corals.min_size_m <= c.corals.max_size_m, "corals need min_size_m <= max_size_m");
}

}  // namespace fathom::sim
