#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "recon/products/tiles/joined_vertices.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {
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

}  // namespace fathom::topside
