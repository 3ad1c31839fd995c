#include "recon/products/tiles/check/tileset_reader.hpp"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "realtime/base/input_error.hpp"

namespace fathom::topside {
namespace {

using JsonTree = nlohmann::json;

constexpr int kMaxDepth = 64;          // of tiles and files in each other
constexpr double kBoxRounding = 1e-6;  // of boxes that were written as centre and half edges [m]

struct Box {
  Eigen::Vector3d low, high;
};

std::optional<double> number(const JsonTree& json) {
  if (!json.is_number()) return std::nullopt;
  const double value = json.get<double>();
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

class Reader {
 public:
  explicit Reader(const std::filesystem::path& folder) : folder_(folder) {}

  ReadTilesets read() {
    JsonTree root = load("tileset.json");
    if (!root.is_object())
      throw InputError((folder_ / "tileset.json").string(), "",
                       "is missing or no JSON; name a folder of tiles");
    file("tileset.json", root, nullptr, 0, 0);
    return std::move(found_);
  }

 private:
  void fault(const std::string& file, const std::string& what) {
    found_.faults.push_back(file + ": " + what);
  }

  [[nodiscard]] JsonTree load(const std::string& path) const {
    std::ifstream stream(folder_ / path, std::ios::binary);
    return stream ? JsonTree::parse(stream, nullptr, false) : JsonTree(JsonTree::value_t::discarded);
  }

  void file(const std::string& path, const JsonTree& json, const Box* within, double error_above, int depth) {
    ++found_.files;
    const auto version = json.find("asset");
    if (version == json.end() || !version->is_object() || version->value("version", JsonTree()) != "1.1")
      fault(path, "asset.version is not 1.1");
    const auto root = json.find("root");
    double error = -1;  // none
    if (const auto found = json.find("geometricError"); found != json.end())
      error = number(*found).value_or(-1);
    if (!(error >= 0)) fault(path, "geometricError is missing or not a length");
    if (root == json.end() || !root->is_object()) return fault(path, "has no root");
    if (!root->contains("refine")) fault(path, "its root does not say how it is refined");
    tile(path, *root, within, within == nullptr ? std::max(error, 0.0) : error_above, within != nullptr,
         depth);
  }

  // The axis-aligned box that this model's tiles have; nothing where it is another.
  std::optional<Box> boxOf(const JsonTree& tile) const {
    const JsonTree* box = nullptr;
    if (const auto volume = tile.find("boundingVolume"); volume != tile.end() && volume->is_object())
      if (const auto found = volume->find("box"); found != volume->end()) box = &*found;
    if (box == nullptr || !box->is_array() || box->size() != 12) return std::nullopt;
    std::array<double, 12> values{};
    for (std::size_t k = 0; k < 12; ++k) {
      const std::optional<double> value = number((*box)[k]);
      if (!value) return std::nullopt;
      values[k] = *value;
    }
    Box out;
    for (int axis = 0; axis < 3; ++axis) {
      const double half = values[static_cast<std::size_t>(3 + 4 * axis)];
      if (half < 0) return std::nullopt;
      out.low[axis] = values[static_cast<std::size_t>(axis)] - half;
      out.high[axis] = values[static_cast<std::size_t>(axis)] + half;
    }
    return out;
  }

  // `same`: the tile stands for the one above, which is in another file: its error may be equal.
  void tile(const std::string& path, const JsonTree& json, const Box* within, double error_above, bool same,
            int depth) {
    if (depth > kMaxDepth) return fault(path, "tiles stand too deep in each other");
    const std::optional<Box> box = boxOf(json);
    if (!box) return fault(path, "a tile without a box");
    if (within != nullptr && ((box->low.array() < within->low.array() - kBoxRounding).any() ||
                              (box->high.array() > within->high.array() + kBoxRounding).any()))
      fault(path, "a tile's box reaches out of its parent's");
    const std::optional<double> error =
        json.contains("geometricError") ? number(json["geometricError"]) : std::nullopt;
    if (!error || *error < 0) return fault(path, "a tile without a geometricError");
    if (*error > error_above || (*error == error_above && *error > 0 && !same))
      fault(path, "a tile's geometricError is not less than its parent's");
    if (const auto content = json.find("content"); content != json.end()) {
      const JsonTree uri = content->is_object() ? content->value("uri", JsonTree()) : JsonTree();
      if (!uri.is_string()) return fault(path, "a content without a uri");
      contentOf(path, uri.get<std::string>(), *box, *error, depth);
    } else if (!json.contains("children")) {
      fault(path, "a tile with neither content nor children");
    }
    if (const auto children = json.find("children"); children != json.end()) {
      if (!children->is_array() || children->empty())
        return fault(path, "children that are no list of tiles");
      for (const JsonTree& child : *children) {
        if (child.is_object())
          tile(path, child, &*box, *error, false, depth + 1);
        else
          fault(path, "a child that is no tile");
      }
    }
  }

  void contentOf(const std::string& path, const std::string& uri, const Box& box, double error, int depth) {
    const std::filesystem::path named = (std::filesystem::path(path).parent_path() / uri).lexically_normal();
    const std::string content = named.generic_string();
    if (named.is_absolute() || content.starts_with(".."))
      return fault(path, uri + " leads out of the folder");
    if (!seen_.insert(content).second) return fault(path, content + " is listed twice");
    if (named.extension() != ".json") {
      found_.tiles.push_back({content, box.low, box.high, error});
      return;
    }
    const JsonTree json = load(content);
    if (!json.is_object()) return fault(content, "is missing or no JSON");
    file(content, json, &box, error, depth + 1);
  }

  std::filesystem::path folder_;
  ReadTilesets found_;
  std::set<std::string> seen_;
};

}  // namespace

ReadTilesets readTilesets(const std::filesystem::path& folder) {
  return Reader(folder).read();
}

}  // namespace fathom::topside
