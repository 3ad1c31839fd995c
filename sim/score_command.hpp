#pragma once

#include <filesystem>
#include <vector>

namespace fathom::sim {

// fathom-sim score: prints how far what was estimated, and further PLY meshes, lie from the truth. Returns
// the exit code; throws InputError.
int runScore(const std::filesystem::path& mission, const std::vector<std::filesystem::path>& surfaces,
             bool json);

}  // namespace fathom::sim
