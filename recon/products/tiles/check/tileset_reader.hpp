#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::topside {

// A tile with content, as tilesets list it.
struct ListedTile {
  std::string path;           // of the content, relative to the folder
  Eigen::Vector3d low, high;  // its box: east, north, up [m]
  double error = 0;           // geometric error [m]
};

struct ReadTilesets {
  std::vector<ListedTile> tiles;  // in the order of the files
  std::size_t files = 0;
  std::vector<std::string> faults;  // a line each
};

// Reads folder/tileset.json and the tilesets that it names, whatever they hold. What breaks the rules of 3D
// Tiles 1.1 or of this model (boxes inside their parent's, errors that fall, each content once, nothing
// outside the folder) is a fault. Throws InputError only where folder/tileset.json is missing or cannot be
// read.
[[nodiscard]] ReadTilesets readTilesets(const std::filesystem::path& folder);

}  // namespace fathom::topside
