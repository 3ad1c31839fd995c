#pragma once

#include <filesystem>
#include <vector>

#include "sim/score/score.hpp"
#include "tests/bench/accuracy/texture_error.hpp"

namespace fathom::accuracy {

// One level of detail against the truth.
struct LevelAccuracy {
  int level = 0;
  std::size_t tiles = 0, triangles = 0;
  double area = 0;            // [m^2]
  sim::SurfaceScore surface;  // aligned by itself
  TextureError texture;       // in the finest level's alignment
};

struct ModelAccuracy {
  SE3 alignment;  // T_truth_model of the finest level
  std::vector<LevelAccuracy> levels;
};

// The model in `results` (tiles/, stereo_pose_est.data) of a simulated mission. Pictures go to `pictures`:
// beside_truth.png and level_<n>.png; none where that is empty. Throws InputError for a mission without truth
// and for results without tiles.
[[nodiscard]] ModelAccuracy measureModel(const std::filesystem::path& mission,
                                         const std::filesystem::path& results,
                                         const std::filesystem::path& pictures);

}  // namespace fathom::accuracy
