#include <array>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "recon/products/tiles/glb.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

// glTF 2.0's numbers (sections 3.6.2.2, 4.4 and 5).
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126, kTriangles = 4;
constexpr double kWidestSteps = 1 << 24;  // whole numbers that single precision holds
constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

void append32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void padTo4(std::vector<std::uint8_t>& out, std::uint8_t with) {
  while (out.size() % 4 != 0) out.push_back(with);
}

// Is on the lattice: the middle of the tile's square, at half the depth of what it holds.
Eigen::Vector3d originOf(const TileMesh& surface, const TileGrid& grid) {
  const std::array<double, 4> box = grid.box(surface.tile);
  float least = surface.mesh.vertices.front().z(), greatest = least;
  for (const Eigen::Vector3f& v : surface.mesh.vertices) {
    least = std::min(least, v.z());
    greatest = std::max(greatest, v.z());
  }
  return {TileGrid::snap((box[0] + box[2]) / 2), TileGrid::snap((box[1] + box[3]) / 2),
          TileGrid::snap((static_cast<double>(least) + static_cast<double>(greatest)) / 2)};
}

// Metres a step of the file: the lattice, or the least power of two above it in which single precision holds
// every coordinate of a tile of more than 8 km.
double stepOf(const Mesh& mesh, const Eigen::Vector3d& origin) {
  double farthest = 0;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    if (!v.allFinite()) throw std::invalid_argument("a vertex that is not finite");
    farthest = std::max(farthest, (v.cast<double>() - origin).cwiseAbs().maxCoeff());
  }
  double step = TileGrid::kLattice;
  while (farthest / step > kWidestSteps / 2) step *= 2;
  return step;
}

FileSurface toFile(const TexturedTile& tile, const Eigen::Vector3d& origin, double step,
                   const GlbConfig& config) {
  const Mesh& mesh = tile.surface.mesh;
  FileSurface file;
  file.triangles = mesh.triangles;
  file.positions.reserve(mesh.vertices.size());
  for (const Eigen::Vector3f& v : mesh.vertices) {
    Eigen::Vector3d steps = gltfFromNav(Eigen::Vector3d(v.cast<double>() - origin)) / step;
    if (step > TileGrid::kLattice) steps = steps.array().round();
    if (steps.array().round().matrix() != steps)
      throw std::invalid_argument("a vertex off the tiles' lattice");
    file.positions.emplace_back(steps.cast<float>());
  }
  for (const Eigen::Vector3f& n : mesh.normals) file.normals.push_back(gltfFromNav(n));
  if (tile.atlas.empty()) {
    for (const Rgb& c : mesh.colours)
      file.colours.push_back({linear16Of(c[0]), linear16Of(c[1]), linear16Of(c[2])});
  } else {
    if (mesh.texture_coordinates.size() != mesh.vertices.size())
      throw std::invalid_argument("a tile with an atlas and without texture coordinates");
    for (const Eigen::Vector2f& t : mesh.texture_coordinates)
      file.texture_coordinates.emplace_back(std::clamp(t.x(), 0.0F, 1.0F),
                                            std::clamp(1.0F - t.y(), 0.0F, 1.0F));
  }
  if (config.sigma)
    for (const float s : mesh.sigma) file.sigma.push_back(std::max(s, 0.0F));
  if (config.views) file.views = tile.surface.views;
  return file;
}

Json accessor(int component, std::size_t count, const char* type, bool normalised = false) {
  Json json{{"componentType", component}, {"count", count}, {"type", type}};
  if (normalised) json["normalized"] = true;
  return json;
}

// The primitive with its accessors; bufferView 0 holds Draco's bytes.
Json primitiveOf(const PackedSurface& packed, const FileSurface& surface, Json& accessors) {
  Json attributes = Json::object(), ids = Json::object();
  const auto name = [&](const char* key, int id, Json described) {
    if (id < 0) return;
    attributes[key] = accessors.size();
    ids[key] = id;
    accessors.push_back(std::move(described));
  };
  Eigen::Vector3f least = surface.positions[surface.triangles[0][0]], greatest = least;
  for (const auto& triangle : surface.triangles)
    for (const std::uint32_t k : triangle) {
      least = least.cwiseMin(surface.positions[k]);
      greatest = greatest.cwiseMax(surface.positions[k]);
    }
  Json positions = accessor(kFloat, packed.vertices, "VEC3");
  positions["min"] = {least.x(), least.y(), least.z()};
  positions["max"] = {greatest.x(), greatest.y(), greatest.z()};
  name("POSITION", packed.position, std::move(positions));
  name("NORMAL", packed.normal, accessor(kFloat, packed.vertices, "VEC3"));
  name("COLOR_0", packed.colour, accessor(kUnsignedShort, packed.vertices, "VEC3", true));
  name("TEXCOORD_0", packed.texture, accessor(kFloat, packed.vertices, "VEC2"));
  name("_SIGMA", packed.sigma, accessor(kFloat, packed.vertices, "SCALAR"));
  name("_VIEWS", packed.views, accessor(kUnsignedShort, packed.vertices, "SCALAR"));
  Json primitive{{"attributes", attributes}, {"indices", accessors.size()}, {"mode", kTriangles}};
  accessors.push_back(accessor(kUnsignedInt, 3 * packed.triangles, "SCALAR"));
  primitive["material"] = 0;
  primitive["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", 0}, {"attributes", ids}};
  return primitive;
}

Json materialOf(const GlbConfig& config, bool textured) {
  Json surface{{"metallicFactor", 0}, {"roughnessFactor", 1}};
  if (textured) surface["baseColorTexture"] = {{"index", 0}};
  // The far side of an overhang's open border is seen from above.
  Json material{{"pbrMetallicRoughness", surface}, {"doubleSided", true}};
  material["extensions"]["KHR_materials_unlit"] = Json::object();
  if (!config.gpu_texture.empty()) material["extras"]["gpu_texture"] = config.gpu_texture;
  return material;
}

// bufferView 1 holds the picture.
void addPicture(Json& json, bool webp) {
  json["samplers"] = {{{"magFilter", kLinear},
                       {"minFilter", kLinearMipmapLinear},
                       {"wrapS", kClampToEdge},
                       {"wrapT", kClampToEdge}}};
  Json texture{{"sampler", 0}};
  if (webp)
    texture["extensions"]["EXT_texture_webp"] = {{"source", 0}};
  else
    texture["source"] = 0;
  json["textures"] = Json::array({texture});
  json["images"] = {{{"bufferView", 1}, {"mimeType", webp ? "image/webp" : "image/jpeg"}}};
}

// The whole file: header, JSON, binary.
std::vector<std::uint8_t> chunked(const std::string& text, const std::vector<std::uint8_t>& binary) {
  std::vector<std::uint8_t> head(text.begin(), text.end());
  padTo4(head, ' ');
  constexpr std::size_t kHeaderBytes = 12, kChunkHeaderBytes = 8;
  const std::size_t total = kHeaderBytes + 2 * kChunkHeaderBytes + head.size() + binary.size();
  std::vector<std::uint8_t> out;
  out.reserve(total);
  append32(out, kGlbMagic);
  append32(out, kGlbVersion);
  append32(out, static_cast<std::uint32_t>(total));
  append32(out, static_cast<std::uint32_t>(head.size()));
  append32(out, kJsonChunk);
  out.insert(out.end(), head.begin(), head.end());
  append32(out, static_cast<std::uint32_t>(binary.size()));
  append32(out, kBinaryChunk);
  out.insert(out.end(), binary.begin(), binary.end());
  return out;
}

}  // namespace

std::vector<std::uint8_t> writeGlb(const TexturedTile& tile, const TileGrid& grid, const GlbConfig& config,
                                   GlbFacts* facts) {
  if (tile.surface.mesh.empty()) throw std::invalid_argument("a tile without triangles");
  const Eigen::Vector3d origin = originOf(tile.surface, grid);
  const double step = stepOf(tile.surface.mesh, origin);
  const FileSurface surface = toFile(tile, origin, step, config);
  DracoConfig draco = config.draco;
  draco.texture_edge = std::max(tile.atlas.width, tile.atlas.height);
  const PackedSurface packed = packSurface(surface, draco);
  const bool has_picture = !tile.atlas.empty() && config.picture.format != PictureFormat::kNone;
  const bool webp = has_picture && config.picture.format == PictureFormat::kWebp;
  const std::vector<std::uint8_t> picture =
      has_picture ? encodePicture(tile.atlas, config.picture) : std::vector<std::uint8_t>{};

  std::vector<std::uint8_t> binary = packed.bytes;
  Json views = Json::array({{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", packed.bytes.size()}}});
  padTo4(binary, 0);
  if (has_picture) {
    views.push_back({{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", picture.size()}});
    binary.insert(binary.end(), picture.begin(), picture.end());
    padTo4(binary, 0);
  }

  Json used = {"KHR_draco_mesh_compression", "KHR_materials_unlit"};
  Json required = {"KHR_draco_mesh_compression"};
  if (webp) {
    used.push_back("EXT_texture_webp");
    required.push_back("EXT_texture_webp");
  }
  const TileId& id = tile.surface.tile;
  Json accessors = Json::array();
  Json primitive = primitiveOf(packed, surface, accessors);
  const Eigen::Vector3d place = gltfFromNav(origin);
  Json json{{"asset", {{"version", "2.0"}, {"generator", "Fathom"}}},
            {"extensionsUsed", used},
            {"extensionsRequired", required},
            {"scene", 0},
            {"scenes", {{{"nodes", {0}}}}},
            {"nodes",
             {{{"mesh", 0},
               {"translation", {place.x(), place.y(), place.z()}},
               {"scale", {step, step, step}},
               {"extras",
                {{"tile", {id.level, id.x, id.y}},
                 {"voxel", grid.voxel},
                 {"leaf_voxels", grid.leaf_voxels},
                 {"error", tile.surface.error},
                 {"texel", tile.texel}}}}}},
            {"meshes", {{{"primitives", Json::array({primitive})}}}},
            {"materials", Json::array({materialOf(config, has_picture)})},
            {"accessors", accessors}};
  if (has_picture) addPicture(json, webp);
  json["bufferViews"] = views;
  json["buffers"] = {{{"byteLength", binary.size()}}};

  std::vector<std::uint8_t> out = chunked(json.dump(), binary);
  if (facts != nullptr) *facts = {packed.bytes.size(), picture.size(), out.size()};
  return out;
}

}  // namespace fathom::topside
