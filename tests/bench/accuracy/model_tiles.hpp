#pragma once

#include <filesystem>
#include <map>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/textured_tile.hpp"

namespace fathom::accuracy {

// The tiles of a model that fathom-topside wrote, level by level.
class ModelTiles {
 public:
  // `folder`: tiles/ of a folder of results. Throws InputError when it holds no tile.
  explicit ModelTiles(const std::filesystem::path& folder);

  [[nodiscard]] std::vector<int> levels() const;
  [[nodiscard]] const std::vector<std::filesystem::path>& filesOf(int level) const {
    return files_.at(level);
  }
  [[nodiscard]] static TexturedTile read(const std::filesystem::path& file);
  // All of a level as one mesh, vertices and triangles alone.
  [[nodiscard]] Mesh surfaceOf(int level) const;

 private:
  std::map<int, std::vector<std::filesystem::path>> files_;
};

}  // namespace fathom::accuracy
