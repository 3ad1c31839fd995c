#pragma once

#include <filesystem>

#include "recon/products/exports/sparse_model.hpp"

namespace fathom::topside {

// A sparse model as nerfstudio's data parser takes it, in `folder`: transforms.json (camera model OPENCV,
// each frame with its camera's numbers and the pose from camera to world, the camera looking along -z with y
// up), points.ply, which it names as ply_file_path, and origin.txt. Images stay where they are: file_path
// leads from `folder` to `images`, the mission's image folder. The top left pixel's centre is (0.5, 0.5). The
// folder appears whole or not at all. Throws InputError where it holds other files.
void writeNerfstudioScene(const std::filesystem::path& folder, const SparseModel& model,
                          const std::filesystem::path& images);

}  // namespace fathom::topside
