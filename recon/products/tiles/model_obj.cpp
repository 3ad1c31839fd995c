#include <algorithm>
#include <array>
#include <charconv>

#include "realtime/base/files/atomic_file.hpp"
#include "recon/products/tiles/joined_vertices.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {
namespace {

constexpr int kPlaceDigits = 4;    // a tenth of a millimetre, a fifth of the lattice's step
constexpr int kTextureDigits = 6;  // a sixtieth of a texel of the widest atlas
constexpr int kJpegQuality = 90;   // of pictures that were stored in another format

void append(std::string& out, double value, int digits) {
  char text[64];
  const auto end = std::to_chars(text, text + sizeof text, value, std::chars_format::fixed, digits).ptr;
  out += ' ';
  out.append(text, end);
}

void appendObjVertex(const TexturedTile& tile, std::uint32_t k, std::string& out) {
  const Mesh& mesh = tile.surface.mesh;
  const Eigen::Vector3f& v = mesh.vertices[k];
  out += 'v';
  for (const float value : {v.y(), v.x(), -v.z()}) append(out, static_cast<double>(value), kPlaceDigits);
  if (tile.atlas.empty() && !mesh.colours.empty())
    for (const std::uint8_t channel : mesh.colours[k]) append(out, channel / 255.0, 3);
  out += '\n';
}

std::vector<std::uint8_t> jpegOf(const ReadTile& read) {
  if (formatOf(read.picture) == PictureFormat::kJpeg) return read.picture;
  return encodePicture(read.tile.atlas, {.quality = kJpegQuality});
}

}  // namespace

ModelCounts writeModelObj(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const std::vector<std::string>& comments) {
  std::sort(tiles.begin(), tiles.end());
  const std::string stem = path.stem().string();
  const std::filesystem::path pictures = path.parent_path() / (stem + "_textures");
  AtomicFile file(path), materials(path.parent_path() / (stem + ".mtl"));
  for (std::string comment : comments) {
    std::replace_if(
        comment.begin(), comment.end(), [](unsigned char c) { return c < ' '; }, ' ');
    file.stream() << "# " << comment << '\n';
  }
  file.stream() << "# axes: x east, y north, z up [m]\nmtllib " << stem << ".mtl\n";
  JoinedVertices joined;
  ModelCounts counts;
  std::uint64_t texture_count = 0;
  for (const TileId& id : tiles) {
    const ReadTile read = source(id);
    const Mesh& mesh = read.tile.surface.mesh;
    const bool textured = !read.tile.atlas.empty() && mesh.texture_coordinates.size() == mesh.vertices.size();
    const JoinedVertices::Numbers numbers = joined.add(read.tile.surface);
    std::string text;
    for (const std::uint32_t k : numbers.added) appendObjVertex(read.tile, k, text);
    if (textured) {
      const std::string name = std::to_string(id.x) + "_" + std::to_string(id.y);
      std::filesystem::create_directories(pictures);
      writeFile(pictures / (name + ".jpg"), jpegOf(read));
      materials.stream() << "newmtl " << name << "\nKd 1 1 1\nKs 0 0 0\nmap_Kd "
                         << pictures.filename().string() << '/' << name << ".jpg\n";
      for (const Eigen::Vector2f& t : mesh.texture_coordinates) {
        text += "vt";
        append(text, static_cast<double>(t.x()), kTextureDigits);
        append(text, static_cast<double>(t.y()), kTextureDigits);
        text += '\n';
      }
      text += "usemtl " + name + '\n';
    }
    for (const auto& t : mesh.triangles) {
      const std::array<std::uint64_t, 3> corner{numbers.of_vertex[t[0]], numbers.of_vertex[t[1]],
                                                numbers.of_vertex[t[2]]};
      if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) continue;
      ++counts.triangles;
      text += 'f';
      for (std::size_t c = 0; c < 3; ++c) {
        text += ' ' + std::to_string(corner[c] + 1);  // OBJ counts from 1
        if (textured) text += '/' + std::to_string(texture_count + t[c] + 1);
      }
      text += '\n';
    }
    file.stream() << text;
    if (textured) texture_count += mesh.vertices.size();
    ++counts.tiles;
  }
  counts.vertices = joined.count();
  materials.commit();
  file.commit();
  return counts;
}

}  // namespace fathom::topside
