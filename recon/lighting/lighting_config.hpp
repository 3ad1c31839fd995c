#pragma once

#include "realtime/base/config_keys.hpp"

namespace fathom::lighting {

// Which model corrects. kAuto: the one that predicts images best before they are learnt.
enum class LightingChoice { kAuto, kWholeImage, kPlain, kRangeDependent };

struct LightingConfig {
  double target_mean = 0.42;   // of full scale, after correction
  double target_sigma = 0.13;  // of full scale
  int min_images = 8;          // before that, one mean and variance for the whole image and channel
  int grid = 48;               // spacing of the statistics' nodes [px]
  double saturated = 0.98;     // of full scale: such samples do not enter the statistics
  double outlier = 3.0;        // robust standard deviations, in logarithms, beyond which a sample is left out
  int memory = 0;              // images after which what was learnt counts half; 0: nothing is forgotten
  LightingChoice choice = LightingChoice::kAuto;
};

// On board, where light and water change over hours: about 300 m of new ground.
inline constexpr int kOnboardMemory = 1000;

// The keys of a [lighting] table.
void visitLighting(KeyVisitor& keys, LightingConfig& config);

// Throws std::invalid_argument for values out of range.
void validate(const LightingConfig& config);

// "auto", "whole", "plain" or "range", as in the file.
[[nodiscard]] const char* nameOf(LightingChoice choice);

}  // namespace fathom::lighting
