#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::bench {

// Heights and colours of a surface at the nodes of a square lattice, without an end: beyond its borders the
// surface is mirrored.
class SeafloorLattice {
 public:
  struct Node {
    float depth = std::numeric_limits<float>::quiet_NaN();  // NaN: the surface has a hole [m]
    Rgb colour{};
  };

  // The uppermost surface of a mesh (PLY) in nav. Colours are the vertices', or of the texture beside it.
  SeafloorLattice(const std::filesystem::path& ply, double spacing);

  // Node (i, j), counted from the surface's corner.
  [[nodiscard]] const Node& at(std::int32_t i, std::int32_t j) const;
  [[nodiscard]] double spacing() const { return spacing_; }

 private:
  double spacing_;
  std::int32_t rows_ = 0, columns_ = 0;
  std::vector<Node> nodes_;
};

}  // namespace fathom::bench
