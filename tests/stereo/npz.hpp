#pragma once

#include <filesystem>
#include <vector>

namespace fathom::test {

struct FloatArray {
  int rows = 0, columns = 0;
  std::vector<float> values;
  [[nodiscard]] float at(int row, int column) const {
    return values[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                  static_cast<std::size_t>(column)];
  }
};

// The first array of a .npz file (a zip of .npy), which must be two-dimensional little-endian float32 in C
// order, stored or deflated. Throws std::runtime_error for anything else.
[[nodiscard]] FloatArray readNpz(const std::filesystem::path& path);

}  // namespace fathom::test
