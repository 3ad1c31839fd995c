#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace fathom::topside {

// Homography of a chart in an image: from (column, row) of a patch's centre, 0 to 5 and 0 to 3 counted from
// dark skin, to pixels (u, v).
using ChartPlace = cv::Matx33d;

// Places where a chart of 24 patches may be, for the caller to decide by their colours. Squares that differ
// from their surroundings in one channel are joined to lattices, each square once; each lattice has a place
// for every position and orientation of 6 x 4 patches that holds most of its squares. `bgr`: 8 bits.
[[nodiscard]] std::vector<std::vector<ChartPlace>> chartPlaces(const cv::Mat& bgr);

}  // namespace fathom::topside
