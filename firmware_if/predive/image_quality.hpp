#pragma once

#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// Light and focus of one image before a dive. Shares of full scale, 0 to 1.
struct ImageQuality {
  double mean = 0;
  double dark_share = 0;       // of the pixels, below 2 % of full scale
  double saturated_share = 0;  // at 99 % and above
  // Width of the sharpest strong edges [px]: grey levels from one side to the other over the steepest slope
  // between them, the sharpest tenth of all found along rows and columns. A step between two pixels gives 2;
  // an edge blurred by a Gaussian of standard deviation s gives s sqrt(2 pi) and a little more. Independent
  // of contrast; noise counts as no edge (slopes below 10 times that of the noise). Bayer images are looked
  // at in blocks of 2 x 2. 0 when there are fewer than kFewestEdges edges.
  double edge_width_px = 0;
  int edges = 0;
  static constexpr int kFewestEdges = 50;
};

// After Marziliano et al., "A no-reference perceptual blur metric", ICIP 2002: edges' widths along lines.
[[nodiscard]] ImageQuality measureImage(const ImageView& image);

}  // namespace fathom::io
