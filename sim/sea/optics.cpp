#include "sim/sea/optics.hpp"

#include <stdexcept>
#include <string>

#include "sim/scenario/range_check.hpp"
#include "sim/scenario/scenario.hpp"

namespace fathom::sim {
namespace {

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(std::string("optics: ") + what);
}

}  // namespace

void validate(const OpticsConfig& config) {
  OpticsConfig walked = config;
  RangeCheck check;
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

}  // namespace fathom::sim
