#include "recon/lighting/lighting_config.hpp"

#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace fathom::lighting {
namespace {

const std::vector<std::string> kChoices = {"auto", "whole", "plain", "range"};

}  // namespace

LightingConfig readLightingConfig(const ConfigTable& table, LightingConfig c) {
  c.target_mean = table.number("target_mean", c.target_mean, 0.05, 0.95);
  c.target_sigma = table.number("target_sigma", c.target_sigma, 0.01, 0.5);
  c.min_images = static_cast<int>(table.integer("min_images", c.min_images, 1, 1000));
  c.grid = static_cast<int>(table.integer("grid_px", c.grid, 4, 256));
  c.saturated = table.number("saturated", c.saturated, 0.5, 1.0);
  c.outlier = table.number("outlier_sigma", c.outlier, 1.0, 10.0);
  c.memory = static_cast<int>(table.integer("memory_images", c.memory, 0, 1'000'000));
  const std::string choice = table.choice("model", nameOf(c.choice), kChoices);
  for (std::size_t k = 0; k < kChoices.size(); ++k)
    if (choice == kChoices[k]) c.choice = static_cast<LightingChoice>(k);
  return c;
}

void validate(const LightingConfig& c) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(std::string("lighting model: ") + what);
  };
  require(c.target_mean > 0 && c.target_mean < 1, "target_mean must be between 0 and 1");
  require(c.target_sigma > 0 && c.target_sigma < 1, "target_sigma must be between 0 and 1");
  require(c.min_images >= 1, "min_images must be at least 1");
  require(c.grid >= 1 && c.grid <= 256, "grid must be 1 to 256 px");
  require(c.saturated > 0 && c.saturated <= 1, "saturated must be between 0 and 1");
  require(c.outlier >= 1, "outlier must be at least 1");
  require(c.memory >= 0, "memory must not be negative");
}

const char* nameOf(LightingChoice choice) {
  return kChoices[static_cast<std::size_t>(choice)].c_str();
}

}  // namespace fathom::lighting
