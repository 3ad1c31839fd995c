#pragma once

#include <filesystem>
#include <vector>

namespace fathom::sim {

// Relief of a real seafloor from a raster of heights.
class ReliefRaster {
 public:
  // First band of any raster that GDAL reads, heights upwards [m]; row 0 is north. Scaled in all directions
  // so that its cells have sides of `cell_m` (only across where the file states none); 0: the size that the
  // file states. Holes are filled from around them. Throws InputError for a file that is no raster or holds
  // no heights, and where neither gives the cells' size.
  ReliefRaster(const std::filesystem::path& file, double cell_m);

  // Depth below the raster's mean [m] at a place north and east of its middle [m], bilinear; mirrored at its
  // edges.
  [[nodiscard]] double depthAt(double north_m, double east_m) const;

 private:
  int columns_ = 0, rows_ = 0;
  double cell_m_ = 1;
  std::vector<float> depths_;
};

}  // namespace fathom::sim
