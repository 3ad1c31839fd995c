#include "tests/bench/accuracy/model_tiles.hpp"

#include <algorithm>
#include <charconv>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/tiles/glb.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::accuracy {

ModelTiles::ModelTiles(const std::filesystem::path& folder) {
  std::error_code error;
  for (const auto& level : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = level.path().filename().string();
    int number = 0;
    const auto [end, bad] = std::from_chars(name.data(), name.data() + name.size(), number);
    if (bad != std::errc() || end != name.data() + name.size() || !level.is_directory()) continue;
    for (const auto& file : std::filesystem::directory_iterator(level.path(), error))
      if (file.path().extension() == ".glb") files_[number].push_back(file.path());
  }
  if (files_.empty())
    throw InputError(folder.string(), "", "holds no tiles; run fathom-topside on the mission first");
  for (auto& [level, files] : files_) std::sort(files.begin(), files.end());
}

std::vector<int> ModelTiles::levels() const {
  std::vector<int> levels;
  for (const auto& [level, files] : files_) levels.push_back(level);
  return levels;
}

TexturedTile ModelTiles::read(const std::filesystem::path& file) {
  return topside::readGlb(test::readBytes(file), file.string()).tile;
}

Mesh ModelTiles::surfaceOf(int level) const {
  Mesh all;
  for (const auto& file : filesOf(level)) {
    const TexturedTile tile = read(file);
    const auto first = static_cast<std::uint32_t>(all.vertices.size());
    const Mesh& mesh = tile.surface.mesh;
    all.vertices.insert(all.vertices.end(), mesh.vertices.begin(), mesh.vertices.end());
    for (const auto& t : mesh.triangles) all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  return all;
}

}  // namespace fathom::accuracy
