#pragma once

#include <cstddef>
#include <filesystem>

namespace fathom::growth {

// The images of a mission by pairs: how many there are (by left images).
[[nodiscard]] std::size_t pairsOf(const std::filesystem::path& mission);

// Makes `part` a mission of the first `pairs` pairs of `mission`: links to their images (or feature files),
// the log up to the first image that is left out, and links to everything else that a run reads. Throws
// InputError for a mission without images or with fewer pairs.
void makePart(const std::filesystem::path& mission, std::size_t pairs, const std::filesystem::path& part);

}  // namespace fathom::growth
