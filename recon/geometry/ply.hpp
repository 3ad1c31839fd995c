#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "realtime/base/files/atomic_file.hpp"
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

// Which attributes the vertices of a mesh have.
struct PlyAttributes {
  bool normals = false, colours = false, texture = false, sigma = false;
};

// A PLY file with the bytes of writePly(), of a mesh that comes in parts: only the part at hand is in memory.
// Throws std::runtime_error when the disk refuses, or for more vertices than the file's indices count.
class PlyParts {
 public:
  PlyParts(const std::filesystem::path& path, std::vector<std::string> comments);

  // Adds vertices that were in no part before; triangles index the vertices of all parts so far. Throws
  // std::invalid_argument for a part without an attribute that the first one has.
  void add(const Mesh& part);
  void commit();
  [[nodiscard]] std::uint64_t vertices() const { return vertices_; }
  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }

 private:
  AtomicFile file_;
  ScratchFile vertex_file_, triangle_file_;
  std::vector<std::string> comments_;
  PlyAttributes with_;  // of the first part
  std::uint64_t vertices_ = 0, triangles_ = 0;
};

}  // namespace fathom
