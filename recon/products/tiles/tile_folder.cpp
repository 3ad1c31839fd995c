#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>

#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/model_file.hpp"
#include "recon/products/tiles/tileset.hpp"

namespace fathom::topside {

TileSource glbSource(const std::filesystem::path& folder) {
  return [folder](const TileId& id) {
    const std::filesystem::path path = folder / tilePath(id);
    std::ifstream stream(path, std::ios::binary);
    if (!stream) throw InputError(path.string(), "", "cannot be opened");
    const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(stream),
                                          std::istreambuf_iterator<char>()};
    return readGlb(bytes, path.string());
  };
}

std::vector<TileId> tilesOfLevel(const std::filesystem::path& folder, int level) {
  const std::filesystem::path place = folder / std::to_string(level);
  std::vector<TileId> tiles;
  if (!std::filesystem::is_directory(place)) return tiles;
  for (const auto& entry : std::filesystem::directory_iterator(place)) {
    if (entry.path().extension() != ".glb") continue;
    const std::string name = entry.path().stem().string();
    TileId id{level, 0, 0};
    const char *begin = name.data(), *end = begin + name.size();
    const auto [middle, bad_x] = std::from_chars(begin, end, id.x);
    if (bad_x != std::errc() || middle == end || *middle != '_') continue;
    const auto [last, bad_y] = std::from_chars(middle + 1, end, id.y);
    if (bad_y == std::errc() && last == end) tiles.push_back(id);
  }
  std::sort(tiles.begin(), tiles.end());
  return tiles;
}

}  // namespace fathom::topside
