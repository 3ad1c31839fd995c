#include "tests/bench/accuracy/model_tiles.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/tiles/glb.hpp"

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
  std::ifstream in(file, std::ios::binary);
  const std::vector<char> bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  return topside::readGlb({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, file.string())
      .tile;
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

double areaOf(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return area;
}

}  // namespace fathom::accuracy
