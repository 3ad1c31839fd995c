#pragma once

#include <filesystem>

namespace fathom::sim {

// fathom-sim score: prints how far what was estimated lies from the truth. Returns the exit code; throws
// InputError.
int runScore(const std::filesystem::path& mission, bool json);

}  // namespace fathom::sim
