#include "recon/products/exports/model_glb.hpp"

#include <array>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::uint64_t kHeads = 12 + 8 + 8;  // of the file and its two chunks [bytes]

// A tile's file, open at its binary chunk.
struct Part {
  std::ifstream stream;
  Json json;
  std::uint32_t binary_bytes = 0;

  explicit Part(const fs::path& path) : stream(path, std::ios::binary) {
    if (!stream) throw InputError(path.string(), "", "cannot be opened");
    const auto head = take<5>();
    std::string text(head[3] <= fs::file_size(path) ? head[3] : 0, ' ');
    stream.read(text.data(), static_cast<std::streamsize>(text.size()));
    const auto binary = take<2>();
    json = Json::parse(text, nullptr, false);
    if (!stream || head[0] != kGlbMagic || head[4] != kJsonChunk || binary[1] != kBinaryChunk ||
        !json.is_object())
      throw InputError(path.string(), "", "is not a tile: make it again with 'fathom-topside run'");
    binary_bytes = binary[0];
  }
  template <std::size_t N>
  std::array<std::uint32_t, N> take() {
    std::array<std::uint32_t, N> words{};
    stream.read(reinterpret_cast<char*>(words.data()), sizeof words);
    return words;
  }
};

void put(std::ostream& out, std::initializer_list<std::uint32_t> words) {
  for (const std::uint32_t word : words) out.write(reinterpret_cast<const char*>(&word), sizeof word);
}

// The JSON of all tiles in one: what a tile counts from 0 goes on where the tiles before it ended.
class JoinedJson {
 public:
  // Throws Json::exception for a tile that is not writeGlb's.
  void add(Json tile) {
    for (const Json& name : tile.at("extensionsUsed")) used_.insert(name.get<std::string>());
    for (const Json& name : tile.at("extensionsRequired")) required_.insert(name.get<std::string>());
    for (Json& view : tile.at("bufferViews"))
      view["byteOffset"] = view.value("byteOffset", std::uint64_t{0}) + binary_bytes;
    for (Json& mesh : tile.at("meshes"))
      for (Json& primitive : mesh.at("primitives")) {
        shift(primitive.at("indices"), "accessors");
        for (auto& [name, accessor] : primitive.at("attributes").items()) shift(accessor, "accessors");
        shift(primitive.at("material"), "materials");
        shift(primitive.at("extensions").at("KHR_draco_mesh_compression").at("bufferView"), "bufferViews");
        const Json& indices =
            tile.at("accessors").at(primitive["indices"].get<std::size_t>() - count("accessors"));
        triangles += indices.at("count").get<std::uint64_t>() / 3;
      }
    vertices += tile.at("accessors").at(0).at("count").get<std::uint64_t>();
    for (Json& node : tile.at("nodes")) shift(node.at("mesh"), "meshes");
    for (Json& material : tile.at("materials")) {
      material.erase("extras");  // the name of a file beside the tile
      Json& surface = material.at("pbrMetallicRoughness");
      if (surface.contains("baseColorTexture")) shift(surface["baseColorTexture"].at("index"), "textures");
    }
    if (tile.contains("textures"))
      for (Json& texture : tile["textures"]) {
        const bool webp = !texture.contains("source");
        shift(webp ? texture.at("extensions").at("EXT_texture_webp").at("source") : texture["source"],
              "images");
      }
    if (tile.contains("images"))
      for (Json& image : tile["images"]) shift(image.at("bufferView"), "bufferViews");
    for (const char* list : kLists)
      if (tile.contains(list))
        for (Json& item : tile[list]) lists_[list].push_back(std::move(item));
    if (tile.contains("samplers")) samplers_ = tile["samplers"];  // one, the same in all
  }
  [[nodiscard]] std::string text() const {
    Json nodes = Json::array();
    for (std::size_t k = 0; k < count("nodes"); ++k) nodes.push_back(k);
    Json all{{"asset", {{"version", "2.0"}, {"generator", "Fathom"}}},
             {"extensionsUsed", used_},
             {"extensionsRequired", required_},
             {"scene", 0},
             {"scenes", {{{"nodes", nodes}}}}};
    for (const auto& [list, items] : lists_.items()) all[list] = items;
    if (!samplers_.is_null()) all["samplers"] = samplers_;
    all["buffers"] = {{{"byteLength", binary_bytes}}};
    std::string text = all.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    return text;
  }

  std::uint64_t binary_bytes = 0, vertices = 0, triangles = 0;

 private:
  static constexpr std::array<const char*, 7> kLists = {"nodes",    "meshes", "materials",  "accessors",
                                                        "textures", "images", "bufferViews"};
  [[nodiscard]] std::size_t count(const char* list) const {
    return lists_.contains(list) ? lists_[list].size() : 0;
  }
  void shift(Json& index, const char* list) const { index = index.get<std::size_t>() + count(list); }

  Json lists_ = Json::object(), samplers_;
  std::set<std::string> used_, required_;
};

}  // namespace

ModelCounts writeModelGlb(const fs::path& path, const fs::path& folder, const std::vector<TileId>& tiles) {
  JoinedJson joined;
  for (const TileId& id : tiles) {
    Part part(folder / tilePath(id));
    try {
      joined.add(std::move(part.json));
    } catch (const Json::exception&) {
      throw InputError((folder / tilePath(id)).string(), "", "is not as 'fathom-topside run' makes tiles");
    }
    joined.binary_bytes += part.binary_bytes;
  }
  const std::string text = joined.text();
  const std::uint64_t bytes = kHeads + text.size() + joined.binary_bytes;
  if (bytes > std::numeric_limits<std::uint32_t>::max())
    throw InputError(path.string(), "",
                     "would have " + std::to_string(bytes >> 20) +
                         " MiB, and a GLB holds 4096; choose a coarser --level, or --obj");
  const auto size = [](std::uint64_t value) { return static_cast<std::uint32_t>(value); };
  AtomicFile file(path);
  put(file.stream(), {kGlbMagic, kGlbVersion, size(bytes), size(text.size()), kJsonChunk});
  file.stream() << text;
  put(file.stream(), {size(joined.binary_bytes), kBinaryChunk});
  for (const TileId& id : tiles) {
    Part part(folder / tilePath(id));
    std::vector<char> binary(part.binary_bytes);
    part.stream.read(binary.data(), static_cast<std::streamsize>(binary.size()));
    if (!part.stream) throw InputError((folder / tilePath(id)).string(), "", "is cut off");
    file.stream().write(binary.data(), static_cast<std::streamsize>(binary.size()));
  }
  file.commit();
  return {tiles.size(), joined.vertices, joined.triangles};
}

}  // namespace fathom::topside
