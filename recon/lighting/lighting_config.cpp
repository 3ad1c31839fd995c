#include "recon/lighting/lighting_config.hpp"

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>

namespace fathom::lighting {
namespace {

constexpr std::array kChoices = {"auto", "whole", "plain", "range"};

}  // namespace

void visitLighting(KeyVisitor& keys, LightingConfig& c) {
  keys.number("target_mean", c.target_mean, "of full scale", 0.05, 0.95, "after correction");
  keys.number("target_sigma", c.target_sigma, "of full scale", 0.01, 0.5, "after correction");
  keys.integer("min_images", c.min_images, "images", 1, 1000,
               "before so many, one correction for the whole image");
  keys.integer("grid_px", c.grid, "px", 4, 256, "spacing of the nodes that statistics are kept at");
  keys.number("saturated", c.saturated, "of full scale", 0.5, 1.0, "brighter samples are not learnt from");
  keys.number("outlier_sigma", c.outlier, "robust deviations", 1.0, 10.0,
              "farther from the median a sample is left out");
  keys.integer("memory_images", c.memory, "images", 0, 1'000'000,
               "of new ground, after which what was learnt counts half; 0: nothing is forgotten");
  keys.choiceOf("model", c.choice, kChoices, "which model corrects; auto: the one that predicts best");
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
  return kChoices[static_cast<std::size_t>(choice)];
}

}  // namespace fathom::lighting
