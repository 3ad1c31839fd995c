#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "recon/geometry/mesh.hpp"

namespace fathom::fusion {

// Number of meshes and their standard deviation of depth in square cells of nav's horizontal plane, before
// fusion (Johnson-Roberson et al. 2010, figure 11). Sums are whole numbers (depths in 2^-14 m, 0.06 mm), so
// that groups of meshes are counted separately and merged in any order to the same bytes.
class CellStatistics {
 public:
  explicit CellStatistics(double cell = 0.10);  // edge [m]; throws std::invalid_argument unless above 0

  struct Cell {
    std::int32_t x = 0, y = 0;  // north, east, in cells (floor)
    std::uint32_t meshes = 0;
    double mean_z = 0;     // of each mesh's mean depth in the cell [m]
    double deviation = 0;  // standard deviation of these between meshes [m]; 0 for one mesh
  };

  // Adds a mesh in nav. It counts in cells of which its triangles cover at least half in plan (less would
  // give the depth of a corner). Triangles that are not finite, beyond kReach of the origin, or more than
  // kMaxSpan cells wide are left out.
  void add(const Mesh& mesh);
  void merge(const CellStatistics& other);        // throws std::invalid_argument for another cell size
  [[nodiscard]] std::vector<Cell> cells() const;  // by x, then y
  // The cell at a place [m]; none without a mesh there.
  [[nodiscard]] std::optional<Cell> at(double north, double east) const;
  [[nodiscard]] double cell() const { return cell_; }

  // Saved state: the same bytes for the same meshes in any order.
  [[nodiscard]] std::vector<std::uint8_t> save() const;
  [[nodiscard]] bool load(const std::vector<std::uint8_t>& bytes);  // false: not a saved state; unchanged

  static constexpr double kReach = 1e5;  // [m]
  static constexpr int kMaxSpan = 1024;  // [cells]

 private:
  __extension__ using Wide = unsigned __int128;
  struct Sums {
    std::uint32_t meshes = 0;
    std::int64_t z = 0;  // [2^-14 m]
    Wide zz = 0;
  };
  struct Share;
  using Shares = std::unordered_map<std::uint64_t, Share>;  // of one mesh, by cell

  static void cut(const std::array<Eigen::Vector3d, 3>& triangle, Shares& shares);
  [[nodiscard]] std::vector<std::uint64_t> keys() const;  // ascending
  [[nodiscard]] static Cell cellOf(std::uint64_t key, const Sums& sums);

  double cell_;
  std::unordered_map<std::uint64_t, Sums> sums_;
};

}  // namespace fathom::fusion
