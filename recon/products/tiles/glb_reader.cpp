#include <cmath>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "recon/products/tiles/glb.hpp"

namespace fathom::topside {
namespace {

using JsonTree = nlohmann::json;

constexpr int kMaxLevel = 12;         // 4^12 leaf tiles are wider than the Earth
constexpr double kWidestPlace = 1e7;  // of a tile from the dive's origin [m]
constexpr int kMaxLeafVoxels = 1 << 16;

// One GLB: its JSON and its binary chunk. Every failure names the file and the place in it.
class Glb {
 public:
  Glb(std::span<const std::uint8_t> bytes, const std::string& name) : name_(name) {
    if (bytes.size() < 20 || number(bytes, 0) != kGlbMagic) fail("first bytes", "are not those of a GLB");
    if (number(bytes, 4) != 2) fail("version", "is not 2");
    if (number(bytes, 8) != bytes.size()) fail("length", "is not the file's: truncated?");
    const std::span<const std::uint8_t> text = chunk(bytes, 12, kJsonChunk);
    json_ = JsonTree::parse(text.begin(), text.end(), nullptr, false);
    if (!json_.is_object()) fail("JSON", "cannot be read");
    binary_ = chunk(bytes, 20 + text.size(), kBinaryChunk);
  }

  [[noreturn]] void fail(const std::string& place, const std::string& fix) const {
    throw InputError(name_, place, fix);
  }
  // The value at a JSON pointer, or null.
  [[nodiscard]] const JsonTree* find(const std::string& pointer) const {
    const JsonTree::json_pointer place(pointer);
    return json_.contains(place) ? &json_[place] : nullptr;
  }
  [[nodiscard]] double real(const std::string& pointer, double least, double greatest) const {
    const JsonTree* value = find(pointer);
    if (value == nullptr || !value->is_number()) fail(pointer, "is missing or not a number");
    const double found = value->get<double>();
    if (!(found >= least && found <= greatest)) fail(pointer, "is out of range");
    return found;
  }
  [[nodiscard]] int whole(const std::string& pointer, double least, double greatest) const {
    const double found = real(pointer, least, greatest);
    if (found != std::floor(found)) fail(pointer, "is not a whole number");
    return static_cast<int>(found);
  }
  [[nodiscard]] std::span<const std::uint8_t> view(int index) const {
    const std::string place = "/bufferViews/" + std::to_string(index);
    const double size = static_cast<double>(binary_.size());
    const JsonTree* offset = find(place + "/byteOffset");
    const double first = offset == nullptr ? 0 : real(place + "/byteOffset", 0, size);
    const double length = real(place + "/byteLength", 0, size);
    if (first + length > size) fail(place, "leads beyond the file");
    return binary_.subspan(static_cast<std::size_t>(first), static_cast<std::size_t>(length));
  }
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  static std::uint32_t number(std::span<const std::uint8_t> bytes, std::size_t at) {
    return bytes[at] | bytes[at + 1] << 8 | bytes[at + 2] << 16 |
           static_cast<std::uint32_t>(bytes[at + 3]) << 24;
  }
  [[nodiscard]] std::span<const std::uint8_t> chunk(std::span<const std::uint8_t> bytes, std::size_t at,
                                                    std::uint32_t kind) const {
    if (bytes.size() - at < 8 || number(bytes, at + 4) != kind)
      fail("byte " + std::to_string(at), "is not the beginning of the chunk that belongs there");
    const std::size_t length = number(bytes, at);
    if (length > bytes.size() - at - 8) fail("byte " + std::to_string(at), "begins a chunk that is cut off");
    return bytes.subspan(at + 8, length);
  }

  std::string name_;
  JsonTree json_;
  std::span<const std::uint8_t> binary_;
};

constexpr const char* kPacked = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";

int attributeId(const Glb& glb, const char* attribute) {
  const std::string place = std::string(kPacked) + "/attributes/" + attribute;
  return glb.find(place) == nullptr ? -1 : glb.whole(place, 0, 255);
}

// The atlas's file; empty where there is none.
std::span<const std::uint8_t> pictureOf(const Glb& glb) {
  const std::string texture = "/textures/0";
  if (glb.find(texture) == nullptr) return {};
  const std::string webp = texture + "/extensions/EXT_texture_webp/source";
  const int image = glb.whole(glb.find(webp) != nullptr ? webp : texture + "/source", 0, 1e6);
  return glb.view(glb.whole("/images/" + std::to_string(image) + "/bufferView", 0, 1e6));
}

std::uint8_t sidesOf(const Eigen::Vector3f& v, const std::array<double, 4>& box) {
  const auto on = [](float value, double plane) {
    return value == static_cast<float>(TileGrid::snap(plane));
  };
  return static_cast<std::uint8_t>((on(v.x(), box[0]) ? kLowNorth : 0) |
                                   (on(v.x(), box[2]) ? kHighNorth : 0) | (on(v.y(), box[1]) ? kLowEast : 0) |
                                   (on(v.y(), box[3]) ? kHighEast : 0));
}

void toNav(const FileSurface& file, const Eigen::Vector3d& origin, double step, const TileGrid& grid,
           TileMesh& surface) {
  Mesh& mesh = surface.mesh;
  const std::array<double, 4> box = grid.box(surface.tile);
  for (const Eigen::Vector3f& p : file.positions) {
    mesh.vertices.emplace_back(
        (origin + step * navFromGltf(Eigen::Vector3d(p.cast<double>()))).cast<float>());
    surface.shared.push_back(sidesOf(mesh.vertices.back(), box));
  }
  for (const Eigen::Vector3f& n : file.normals) mesh.normals.push_back(navFromGltf(n).normalized());
  for (const auto& c : file.colours) mesh.colours.push_back({srgb8Of(c[0]), srgb8Of(c[1]), srgb8Of(c[2])});
  for (const Eigen::Vector2f& t : file.texture_coordinates)
    mesh.texture_coordinates.emplace_back(t.x(), 1.0F - t.y());
  mesh.sigma = file.sigma;
  mesh.triangles = file.triangles;
  surface.views = file.views;
}

}  // namespace

ReadTile readGlb(std::span<const std::uint8_t> bytes, const std::string& name, ReadPicture picture) {
  const Glb glb(bytes, name);
  ReadTile read;
  TileMesh& surface = read.tile.surface;
  const std::string extras = "/nodes/0/extras";
  surface.tile = {glb.whole(extras + "/tile/0", 0, kMaxLevel), glb.whole(extras + "/tile/1", -1e9, 1e9),
                  glb.whole(extras + "/tile/2", -1e9, 1e9)};
  read.grid = {glb.real(extras + "/voxel", 1e-4, 1e3), glb.whole(extras + "/leaf_voxels", 1, kMaxLeafVoxels)};
  surface.error = glb.real(extras + "/error", 0, kWidestPlace);
  read.tile.texel = glb.real(extras + "/texel", 0, kWidestPlace);
  const std::string place = "/nodes/0/translation";
  const Eigen::Vector3d origin =
      navFromGltf(Eigen::Vector3d(glb.real(place + "/0", -kWidestPlace, kWidestPlace),
                                  glb.real(place + "/1", -kWidestPlace, kWidestPlace),
                                  glb.real(place + "/2", -kWidestPlace, kWidestPlace)));
  const SurfaceIds ids{attributeId(glb, "POSITION"), attributeId(glb, "NORMAL"),
                       attributeId(glb, "COLOR_0"),  attributeId(glb, "TEXCOORD_0"),
                       attributeId(glb, "_SIGMA"),   attributeId(glb, "_VIEWS")};
  toNav(unpackSurface(glb.view(glb.whole(std::string(kPacked) + "/bufferView", 0, 1e6)), ids, name), origin,
        glb.real("/nodes/0/scale/0", TileGrid::kLattice, 1), read.grid, surface);
  if (const JsonTree* beside = glb.find("/materials/0/extras/gpu_texture")) {
    if (!beside->is_string() || beside->get<std::string>().find_first_of("/\\") != std::string::npos)
      glb.fail("/materials/0/extras/gpu_texture", "is not the name of a file beside the tile");
    read.gpu_texture = beside->get<std::string>();
  }
  if (picture == ReadPicture::kSkip) return read;
  const std::span<const std::uint8_t> file = pictureOf(glb);
  if (file.empty()) return read;
  read.picture.assign(file.begin(), file.end());
  if (picture == ReadPicture::kDecode) read.tile.atlas = decodePicture(file, name);
  return read;
}

}  // namespace fathom::topside
