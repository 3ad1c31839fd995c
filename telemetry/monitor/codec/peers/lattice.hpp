#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::peers {

// Heights on a lattice, row by row [m]; NaN where the surface has a hole.
struct Lattice {
  int rows = 0, cols = 0;
  double cell = 0;  // [m]
  std::vector<float> depth;

  [[nodiscard]] std::size_t at(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(cols) + static_cast<std::size_t>(j);
  }
};

// A peer's result for a whole lattice within `max_error` at every node; without frames, check and position.
struct PeerResult {
  std::string name;
  std::string setting;    // with the fewest bytes
  std::size_t bytes = 0;  // 0: nothing held the error
  double max_error = 0;   // over the nodes sent [m]
  double rms_error = 0;   // [m]
  double encode_ms = 0;   // of that setting
  std::size_t nodes = 0;  // sent
};

// Two triangles a cell whose four nodes are there, one where three are.
[[nodiscard]] Mesh latticeMesh(const Lattice& lattice);
// The lattice with its holes filled smoothly from their borders (membrane), for coders without holes.
[[nodiscard]] Lattice filled(const Lattice& lattice);
// Bytes of the mask of seen nodes under an adaptive arithmetic coder with a context of ten neighbours, as
// JBIG has (ITU-T T.82); 0 for a full lattice.
[[nodiscard]] std::size_t maskBytes(const Lattice& lattice);

// Errors of `depth` (as many as the lattice's nodes) where the lattice is seen; NaN there counts as infinite.
struct Errors {
  double max = 0, rms = 0;
  std::size_t nodes = 0;
};
[[nodiscard]] Errors errors(const Lattice& lattice, std::span<const float> depth);

// Draco, speed 0, the fewest bits of quantisation that hold the error: of the regular grid as a mesh.
[[nodiscard]] PeerResult dracoGrid(const Lattice& lattice, double max_error);
// The same with whole numbers for places, which lose nothing, and steps of twice the error for heights.
[[nodiscard]] PeerResult dracoWholeNumbers(const Lattice& lattice, double max_error);
// JPEG 2000 (OpenJPEG), reversible 5/3 on heights in steps of twice the error, and the mask's bytes.
[[nodiscard]] PeerResult jpeg2000Reversible(const Lattice& lattice, double max_error);
// Irreversible 9/7, the lowest quality that holds the error, and the mask's bytes.
[[nodiscard]] PeerResult jpeg2000Irreversible(const Lattice& lattice, double max_error);

// All of them, in this order.
[[nodiscard]] std::vector<PeerResult> allPeers(const Lattice& lattice, double max_error);

}  // namespace fathom::peers
