#pragma once

#include <vector>

namespace fathom::calibration {

// The seafloor's distance below the camera, as stereo has it and as the DVL has it [m].
struct RangeSample {
  double stereo = 0, dvl = 0;
};

struct RangeCheck {
  std::size_t samples = 0;
  double ratio = 1, ratio_sigma = 0;  // stereo = ratio * dvl
  double scatter = 0;                 // of one sample about that, relative
  double shortest = 0, longest = 0;   // of the DVL's: 5th and 95th percentile [m]
  // stereo = scale * dvl + offset; only when the ranges span enough to tell the two apart.
  bool line_known = false;
  double scale = 1, scale_sigma = 0;
  double offset = 0, offset_sigma = 0;  // [m]
};

// Robust: ratio by the median, line by iteratively reweighted least squares (Cauchy). Neighbouring samples
// see the same seafloor and are not independent: standard deviations come from how consecutive blocks of
// samples (in order of time) differ. Fewer than 8 samples give samples alone.
[[nodiscard]] RangeCheck checkRanges(const std::vector<RangeSample>& samples);

}  // namespace fathom::calibration
