#include "telemetry/monitor/codec/peers/lattice.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "telemetry/map/range_coder.hpp"

namespace fathom::peers {

Mesh latticeMesh(const Lattice& lattice) {
  Mesh mesh;
  std::vector<std::uint32_t> id(lattice.depth.size(), 0);
  for (int i = 0; i < lattice.rows; ++i) {
    for (int j = 0; j < lattice.cols; ++j) {
      const float depth = lattice.depth[lattice.at(i, j)];
      if (std::isnan(depth)) continue;
      id[lattice.at(i, j)] = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.emplace_back(static_cast<float>(i * lattice.cell), static_cast<float>(j * lattice.cell),
                                 depth);
    }
  }
  for (int i = 0; i + 1 < lattice.rows; ++i) {
    for (int j = 0; j + 1 < lattice.cols; ++j) {
      // Counter-clockwise from above (z is down).
      const std::array<std::size_t, 4> corner{lattice.at(i, j), lattice.at(i, j + 1),
                                              lattice.at(i + 1, j + 1), lattice.at(i + 1, j)};
      std::vector<std::uint32_t> seen;
      for (const std::size_t k : corner)
        if (!std::isnan(lattice.depth[k])) seen.push_back(id[k]);
      if (seen.size() >= 3) mesh.triangles.push_back({seen[0], seen[1], seen[2]});
      if (seen.size() == 4) mesh.triangles.push_back({seen[0], seen[2], seen[3]});
    }
  }
  return mesh;
}

Lattice filled(const Lattice& lattice) {
  constexpr int kSweeps = 2000;  // of Gauss-Seidel; holes are tens of nodes wide
  Lattice out = lattice;
  double sum = 0;
  std::size_t seen = 0;
  for (const float z : lattice.depth) {
    if (std::isnan(z)) continue;
    sum += static_cast<double>(z);
    ++seen;
  }
  std::vector<std::size_t> holes;
  for (std::size_t k = 0; k < out.depth.size(); ++k) {
    if (!std::isnan(out.depth[k])) continue;
    holes.push_back(k);
    out.depth[k] = static_cast<float>(sum / static_cast<double>(seen));
  }
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (const std::size_t k : holes) {
      const int i = static_cast<int>(k) / lattice.cols, j = static_cast<int>(k) % lattice.cols;
      float around = 0;
      int count = 0;
      const auto add = [&](int r, int c) {
        if (r < 0 || c < 0 || r >= lattice.rows || c >= lattice.cols) return;
        around += out.depth[lattice.at(r, c)];
        ++count;
      };
      add(i - 1, j);
      add(i + 1, j);
      add(i, j - 1);
      add(i, j + 1);
      out.depth[k] = around / static_cast<float>(count);
    }
  }
  return out;
}

std::size_t maskBytes(const Lattice& lattice) {
  if (std::none_of(lattice.depth.begin(), lattice.depth.end(), [](float z) { return std::isnan(z); }))
    return 0;
  const auto seen = [&](int i, int j) {
    return i >= 0 && j >= 0 && j < lattice.cols && !std::isnan(lattice.depth[lattice.at(i, j)]);
  };
  constexpr std::array<std::array<int, 2>, 10> kTemplate{
      {{0, -1}, {0, -2}, {0, -3}, {0, -4}, {-1, -2}, {-1, -1}, {-1, 0}, {-1, 1}, {-1, 2}, {-2, 0}}};
  std::vector<telemetry::AdaptiveBit> chance(1U << kTemplate.size());
  std::vector<std::uint8_t> out(lattice.depth.size() + 64);
  telemetry::RangeEncoder coder(out);
  for (int i = 0; i < lattice.rows; ++i) {
    for (int j = 0; j < lattice.cols; ++j) {
      std::size_t context = 0;
      for (const auto& [di, dj] : kTemplate) context = context << 1 | (seen(i + di, j + dj) ? 1U : 0U);
      telemetry::codeBit(coder, chance[context], seen(i, j));
    }
  }
  return coder.finish();
}

Errors errors(const Lattice& lattice, std::span<const float> depth) {
  Errors out;
  double sum = 0;
  for (std::size_t k = 0; k < lattice.depth.size(); ++k) {
    if (std::isnan(lattice.depth[k])) continue;
    const double error =
        std::isnan(depth[k])
            ? std::numeric_limits<double>::infinity()
            : std::abs(static_cast<double>(depth[k]) - static_cast<double>(lattice.depth[k]));
    out.max = std::max(out.max, error);
    sum += error * error;
    ++out.nodes;
  }
  out.rms = out.nodes > 0 ? std::sqrt(sum / static_cast<double>(out.nodes)) : 0;
  return out;
}

std::vector<PeerResult> allPeers(const Lattice& lattice, double max_error) {
  return {dracoGrid(lattice, max_error), dracoWholeNumbers(lattice, max_error),
          jpeg2000Reversible(lattice, max_error), jpeg2000Irreversible(lattice, max_error)};
}

}  // namespace fathom::peers
