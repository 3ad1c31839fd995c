#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {

std::size_t JoinedVertices::Hash::operator()(const Place& place) const {
  std::uint64_t hash = 0;
  for (const float v : place) hash = hash64(hash, std::bit_cast<std::uint32_t>(v));
  return hash;
}

JoinedVertices::Numbers JoinedVertices::add(const TileMesh& tile) {
  if (tile.tile.x != x_) {
    last_row_.clear();
    if (tile.tile.x == x_ + 1) last_row_.swap(next_row_);
    next_row_.clear();
    row_.clear();
    x_ = tile.tile.x;
  }
  Numbers numbers;
  Known inside;
  const auto& vertices = tile.mesh.vertices;
  numbers.of_vertex.reserve(vertices.size());
  inside.reserve(vertices.size());
  for (std::uint32_t k = 0; k < vertices.size(); ++k) {
    // Adding zero makes -0 and 0 the same place.
    const Place place{vertices[k].x() + 0.0F, vertices[k].y() + 0.0F, vertices[k].z() + 0.0F};
    const std::uint8_t shared = tile.shared[k];
    const auto known = [&](const Known& among) {
      const auto found = among.find(place);
      return found == among.end() ? count_ : found->second;
    };
    std::uint64_t number = known(inside);
    if (number == count_ && (shared & kLowNorth) != 0) number = known(last_row_);
    if (number == count_ && (shared & (kLowEast | kLowNorth)) != 0) number = known(row_);
    if (number == count_) {
      numbers.added.push_back(k);
      ++count_;
    }
    inside.emplace(place, number);
    if (shared != 0) row_.emplace(place, number);
    if ((shared & kHighNorth) != 0) next_row_.emplace(place, number);
    numbers.of_vertex.push_back(number);
  }
  return numbers;
}

namespace {

constexpr Rgb kGrey{128, 128, 128};  // of a tile that has no colours

template <typename Number>
void putValue(std::string& out, Number value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

struct Properties {
  bool sigma = false, views = false;
};

// Always the same length, so that the counts can be filled in at the end.
std::string headerOf(const ModelCounts& counts, const Properties& properties,
                     const std::vector<std::string>& comments) {
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment axes: x east, y north, z up [m]\n";
  for (std::string comment : comments) {
    std::replace_if(
        comment.begin(), comment.end(), [](unsigned char c) { return c < ' '; }, ' ');
    text += "comment " + comment + "\n";
  }
  const std::string vertices = std::to_string(counts.vertices), faces = std::to_string(counts.triangles);
  constexpr std::size_t kDigits = 20;  // of the greatest 64-bit number
  text += "comment " + std::string(2 * kDigits - vertices.size() - faces.size(), '-') + "\n";
  text += "element vertex " + vertices +
          "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n"
          "property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (properties.sigma) text += "property float sigma\n";
  if (properties.views) text += "property ushort views\n";
  return text + "element face " + faces + "\nproperty list uchar int vertex_indices\nend_header\n";
}

void appendPlyVertex(const TexturedTile& tile, std::uint32_t k, const Properties& properties,
                     std::string& out) {
  const Mesh& mesh = tile.surface.mesh;
  const Eigen::Vector3f& v = mesh.vertices[k];
  const Eigen::Vector3f n = mesh.normals.empty() ? Eigen::Vector3f(0, 0, -1) : mesh.normals[k];
  for (const float value : {v.y(), v.x(), -v.z(), n.y(), n.x(), -n.z()}) putValue(out, value);
  for (const std::uint8_t channel : vertexColour(tile, k)) putValue(out, channel);
  if (properties.sigma) putValue(out, mesh.sigma.empty() ? 0.0F : mesh.sigma[k]);
  if (properties.views)
    putValue(out, static_cast<std::uint16_t>(tile.surface.views.empty() ? 0 : tile.surface.views[k]));
}

}  // namespace

Rgb vertexColour(const TexturedTile& tile, std::size_t vertex) {
  const Mesh& mesh = tile.surface.mesh;
  if (!tile.atlas.empty() && !mesh.texture_coordinates.empty()) {
    const Eigen::Vector2f& t = mesh.texture_coordinates[vertex];
    const auto texel = [](float place, int count) {
      return std::clamp(static_cast<int>(place * static_cast<float>(count)), 0, count - 1);
    };
    const std::uint8_t* rgb =
        tile.atlas.at(texel(t.x(), tile.atlas.width), texel(1 - t.y(), tile.atlas.height));
    return {rgb[0], rgb[1], rgb[2]};
  }
  return mesh.colours.empty() ? kGrey : mesh.colours[vertex];
}

ModelCounts writeModelPly(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const std::vector<std::string>& comments) {
  std::sort(tiles.begin(), tiles.end());
  AtomicFile file(path);
  ScratchFile faces(path.string() + ".faces.tmp");
  JoinedVertices joined;
  ModelCounts counts;
  Properties properties;
  for (const TileId& id : tiles) {
    const ReadTile read = source(id);
    const TileMesh& surface = read.tile.surface;
    if (counts.tiles++ == 0) {
      properties = {!surface.mesh.sigma.empty(), !surface.views.empty()};
      file.stream() << headerOf(counts, properties, comments);
    }
    const JoinedVertices::Numbers numbers = joined.add(surface);
    std::string bytes;
    for (const std::uint32_t k : numbers.added) appendPlyVertex(read.tile, k, properties, bytes);
    file.stream().write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    bytes.clear();
    for (const auto& t : surface.mesh.triangles) {
      const std::array<std::uint64_t, 3> corner{numbers.of_vertex[t[0]], numbers.of_vertex[t[1]],
                                                numbers.of_vertex[t[2]]};
      if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) continue;
      ++counts.triangles;
      putValue(bytes, std::uint8_t{3});
      for (const std::uint64_t number : corner) putValue(bytes, static_cast<std::int32_t>(number));
    }
    faces.stream().write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (joined.count() > INT32_MAX)
      throw std::runtime_error("a PLY file of more vertices than its indices count");
  }
  counts.vertices = joined.count();
  if (counts.tiles == 0) file.stream() << headerOf(counts, properties, comments);
  faces.appendTo(file.stream());
  file.stream().seekp(0);
  file.stream() << headerOf(counts, properties, comments);
  file.commit();
  return counts;
}

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
