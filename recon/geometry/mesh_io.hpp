#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom {

// Reads a PLY mesh (ascii or binary, either byte order): vertex x y z, and where present nx ny nz, red green
// blue, s t (or u v, texture_u texture_v), sigma; polygons are split into fans. Unknown elements and
// properties are skipped. Throws InputError for anything else: truncation, an index out of range, a number
// that is not finite.
[[nodiscard]] Mesh readPly(const std::filesystem::path& path);

// Writes little-endian binary PLY with the attributes that the mesh has; to a temporary name, then renamed.
void writePly(const std::filesystem::path& path, const Mesh& mesh,
              const std::vector<std::string>& comments = {});
// The same into a stream that the caller opened.
void writePly(std::ostream& stream, const Mesh& mesh, const std::vector<std::string>& comments = {});

}  // namespace fathom
