#include "recon/products/tiles/tileset.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kLevelsAFile = 3;  // 16 + 256 + the one that roots them
// A parent's error over its greatest child's, at least, so that errors fall from level to level.
constexpr double kLeastFall = 1.01;
// What drawing nothing would cost, over the root's own error.
constexpr double kErrorOfNothing = 4;

struct Node {
  bool content = false;
  Eigen::Vector3d low, high;
  double error = 0;
  std::vector<TileId> children;  // ascending
};
using Tree = std::map<TileId, Node>;

void enclose(Node& node, const Node& child) {
  node.low = node.low.cwiseMin(child.low);
  node.high = node.high.cwiseMax(child.high);
}

// Tiles with the ancestors that they lack, up to one root, which is returned.
TileId grow(Tree& tree, const std::vector<TileEntry>& entries, const TilesetConfig& config) {
  int top = 0;
  for (const TileEntry& entry : entries) {
    top = std::max(top, entry.id.level);
    if (!tree.try_emplace(entry.id, Node{true,
                                         entry.low,
                                         entry.high,
                                         std::max(entry.error, config.error_per_texel * entry.texel),
                                         {}})
             .second)
      throw std::invalid_argument("a tile stands twice in a tileset");
  }
  for (int level = 0;; ++level) {
    std::vector<TileId> here;
    for (auto it = tree.lower_bound({level, INT32_MIN, INT32_MIN});
         it != tree.end() && it->first.level == level; ++it)
      here.push_back(it->first);
    if (level >= top && here.size() == 1) return here.front();
    // Tiles on both sides of nav's origin have no common ancestor.
    const bool meets_origin = level >= top && std::all_of(here.begin(), here.end(), [](const TileId& id) {
                                return id.x >= -1 && id.x <= 0 && id.y >= -1 && id.y <= 0;
                              });
    for (const TileId& id : here) {
      const TileId up = meets_origin ? TileId{level + 1, 0, 0} : TileGrid::parent(id);
      const Node child = tree.at(id);
      Node& parent = tree.try_emplace(up, Node{false, child.low, child.high, 0, {}}).first->second;
      enclose(parent, child);
      parent.children.push_back(id);
      parent.error = std::max(parent.error, child.error * kLeastFall);
      // Without content, all that it stands for would be missing from the picture.
      if (!parent.content) parent.error = std::max(parent.error, (parent.high - parent.low).norm());
    }
  }
}

Json boxOf(const Node& node) {
  const Eigen::Vector3d centre = (node.low + node.high) / 2, half = (node.high - node.low) / 2;
  return {{"box", {centre.y(), centre.x(), -centre.z(), half.y(), 0, 0, 0, half.x(), 0, 0, 0, half.z()}}};
}

void write(const std::filesystem::path& path, const Json& root, double error) {
  const Json tileset{
      {"asset", {{"version", "1.1"}, {"generator", "Fathom"}}}, {"geometricError", error}, {"root", root}};
  writeFile(path, tileset.dump() + "\n");
}

// One file's part of the tree.
class Part {
 public:
  Part(const std::filesystem::path& folder, const Tree& tree, TileId root, bool cut)
      : folder_(folder), tree_(tree), root_(root), cut_(cut), at_top_(true) {}
  Part(const Part& above, TileId root)
      : folder_(above.folder_), tree_(above.tree_), root_(root), cut_(true), at_top_(false) {}

  [[nodiscard]] Json json(const TileId& id) const {
    const Node& node = tree_.at(id);
    const bool elsewhere = cut_ && id != root_ && !node.children.empty() && id.level % kLevelsAFile == 2;
    Json tile{{"boundingVolume", boxOf(node)}, {"geometricError", node.children.empty() ? 0 : node.error}};
    if (id == root_ || elsewhere) tile["refine"] = "REPLACE";
    if (elsewhere) {
      tile["content"] = {{"uri", relative(id, ".json")}};
      std::filesystem::create_directories((folder_ / tilePath(id, ".json")).parent_path());
      write(folder_ / tilePath(id, ".json"), Part(*this, id).json(id), node.error);
      return tile;
    }
    if (node.content) tile["content"] = {{"uri", relative(id, ".glb")}};
    for (const TileId& child : node.children) tile["children"].push_back(json(child));
    return tile;
  }

 private:
  [[nodiscard]] std::string relative(const TileId& id, const std::string& ending) const {
    return (at_top_ ? "" : "../") + tilePath(id, ending);
  }

  const std::filesystem::path& folder_;
  const Tree& tree_;
  TileId root_;
  bool cut_, at_top_;
};

}  // namespace

TileEntry entryOf(const TexturedTile& tile) {
  if (tile.surface.mesh.vertices.empty()) throw std::invalid_argument("a tile without vertices");
  Eigen::Vector3f low = tile.surface.mesh.vertices.front(), high = low;
  for (const Eigen::Vector3f& v : tile.surface.mesh.vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
  return {tile.surface.tile, low.cast<double>(), high.cast<double>(), tile.surface.error, tile.texel};
}

std::string tilePath(const TileId& id, const std::string& ending) {
  return std::to_string(id.level) + "/" + std::to_string(id.x) + "_" + std::to_string(id.y) + ending;
}

Eigen::Matrix4d ecefFromEnu(const Geodetic& origin) {
  constexpr double kSemiMajor = 6378137.0, kFlattening = 1 / 298.257223563;  // WGS84 [m]
  constexpr double kEccentricity2 = kFlattening * (2 - kFlattening);
  const double sin_lat = std::sin(origin.latitude), cos_lat = std::cos(origin.latitude);
  const double sin_lon = std::sin(origin.longitude), cos_lon = std::cos(origin.longitude);
  const double radius = kSemiMajor / std::sqrt(1 - kEccentricity2 * sin_lat * sin_lat);
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.col(0).head<3>() << -sin_lon, cos_lon, 0;
  matrix.col(1).head<3>() << -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat;
  matrix.col(2).head<3>() << cos_lat * cos_lon, cos_lat * sin_lon, sin_lat;
  matrix.col(3).head<3>() << radius * cos_lat * cos_lon, radius * cos_lat * sin_lon,
      radius * (1 - kEccentricity2) * sin_lat;
  return matrix;
}

void writeTilesets(const std::filesystem::path& folder, std::vector<TileEntry> entries,
                   const std::optional<Geodetic>& origin, const TilesetConfig& config) {
  if (entries.empty()) throw std::invalid_argument("a tileset without tiles");
  std::sort(entries.begin(), entries.end(),
            [](const TileEntry& a, const TileEntry& b) { return a.id < b.id; });
  Tree tree;
  const TileId root = grow(tree, entries, config);
  Json json = Part(folder, tree, root, entries.size() > config.max_tiles).json(root);
  if (origin) {
    const Eigen::Matrix4d transform = ecefFromEnu(*origin);
    json["transform"] = std::vector<double>(transform.data(), transform.data() + transform.size());
  }
  write(folder / "tileset.json", json, kErrorOfNothing * tree.at(root).error);
}

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
