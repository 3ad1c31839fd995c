#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "recon/products/rasters/cog_writer.hpp"

namespace fathom::topside {

// Values in cells of a lattice, in memory, in squares of 64 x 64 cells.
class SparseCells {
 public:
  explicit SparseCells(double cell) : cell_(cell) {}
  void set(std::int32_t x, std::int32_t y, float value);
  [[nodiscard]] float get(std::int32_t x, std::int32_t y) const;  // NaN where nothing was set
  [[nodiscard]] double cell() const { return cell_; }
  [[nodiscard]] CellWindow extent() const;
  [[nodiscard]] bool touches(const CellWindow& window) const;
  void read(const CellWindow& window, float* out) const;

 private:
  using Key = std::pair<std::int32_t, std::int32_t>;
  double cell_;
  std::map<Key, std::vector<float>> squares_;
  CellWindow extent_;
};

[[nodiscard]] RasterSource sourceOf(const std::shared_ptr<const SparseCells>& cells);

}  // namespace fathom::topside
