#pragma once

#include <filesystem>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// Reads a PLY mesh (ascii or binary, either byte order): vertex x y z, and where present nx ny nz, red green
// blue, s t (or u v, texture_u texture_v), sigma; polygons are split into fans. Unknown elements and
// properties are skipped. Throws InputError for anything else: truncation, an index out of range, a number
// that is not finite.
[[nodiscard]] Mesh readPly(const std::filesystem::path& path);

}  // namespace fathom
