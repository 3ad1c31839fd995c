#pragma once

#include <filesystem>

#include "recon/products/exports/sparse_model.hpp"

namespace fathom::topside {

enum class ColmapFormat { kBinary, kText };

// A sparse model as COLMAP's tools read it, in `folder`: cameras, images and points3D (.bin or .txt), as
// colmap.github.io/format.html describes them, and origin.txt, which says where on the Earth the origin is.
// Cameras 1 and 2 are left and right, OPENCV, or FULL_OPENCV where there is a k3; images 2k + 1 and 2k + 2
// are pair k's, with the pose from world to camera; every point has a track. In COLMAP the top left pixel's
// centre is (0.5, 0.5), which principal points and pixels are moved to. The folder appears whole or not at
// all. Throws InputError where it holds other files.
void writeColmapModel(const std::filesystem::path& folder, const SparseModel& model, ColmapFormat format);

}  // namespace fathom::topside
