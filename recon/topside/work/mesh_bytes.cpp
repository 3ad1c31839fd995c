#include "recon/topside/work/mesh_bytes.hpp"

#include <type_traits>

#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint64_t kMost = 1U << 28;  // of anything in one mesh
constexpr std::size_t kShort = 65536;      // vertices of a mesh whose indices take 16 bits

// The numbers of a list without gaps between them, whatever type holds them.
template <typename Archive, typename T>
void exchangeList(Archive& archive, T& list) {
  using Element = typename std::remove_const_t<T>::value_type;
  std::uint64_t count = list.size();
  archive(count);
  if constexpr (Archive::kLoading) {
    archive.require(count <= kMost && count * sizeof(Element) <= archive.left(), "a list is too long");
    if (!archive.ok()) return;
    list.resize(count);
  }
  archive.bytes(list.data(), list.size() * sizeof(Element));
}

template <typename Archive>
void exchangeTriangles(Archive& archive, auto& mesh) {
  std::vector<std::array<std::uint16_t, 3>> small;
  if constexpr (!Archive::kLoading) {
    if (mesh.vertices.size() <= kShort)
      for (const auto& [a, b, c] : mesh.triangles)
        small.push_back(
            {static_cast<std::uint16_t>(a), static_cast<std::uint16_t>(b), static_cast<std::uint16_t>(c)});
  }
  if (mesh.vertices.size() > kShort) {
    exchangeList(archive, mesh.triangles);
  } else {
    exchangeList(archive, small);
    if constexpr (Archive::kLoading) {
      mesh.triangles.clear();
      for (const auto& [a, b, c] : small) mesh.triangles.push_back({a, b, c});
    }
  }
  if constexpr (Archive::kLoading)
    for (const auto& triangle : mesh.triangles)
      for (const std::uint32_t v : triangle)
        archive.require(v < mesh.vertices.size(), "a triangle has no such vertex");
}

template <typename Archive>
void exchangeMesh(Archive& archive, auto& mesh) {
  exchangeList(archive, mesh.vertices);
  exchangeList(archive, mesh.normals);
  exchangeList(archive, mesh.colours);
  exchangeList(archive, mesh.texture_coordinates);
  exchangeList(archive, mesh.sigma);
  const auto fits = [&](std::size_t size) { return size == 0 || size == mesh.vertices.size(); };
  archive.require(fits(mesh.normals.size()) && fits(mesh.colours.size()) &&
                      fits(mesh.texture_coordinates.size()) && fits(mesh.sigma.size()),
                  "a list is not as long as the vertices");
  exchangeTriangles(archive, mesh);
}

template <typename Archive>
void exchangeTile(Archive& archive, auto& tile) {
  auto& surface = tile.surface;
  archive(surface.tile.level, surface.tile.x, surface.tile.y, surface.error, tile.texel);
  exchangeMesh(archive, surface.mesh);
  exchangeList(archive, surface.shared);
  exchangeList(archive, surface.views);
  archive(tile.atlas.width, tile.atlas.height);
  exchangeList(archive, tile.atlas.rgb);
  const std::size_t vertices = surface.mesh.vertices.size();
  archive.require(
      surface.shared.size() == vertices && (surface.views.empty() || surface.views.size() == vertices),
      "a list is not as long as the vertices");
  archive.require(
      tile.atlas.width >= 0 && tile.atlas.height >= 0 &&
          static_cast<std::uint64_t>(tile.atlas.width) * static_cast<std::uint64_t>(tile.atlas.height) * 3 ==
              tile.atlas.rgb.size(),
      "an image has not its size");
}

}  // namespace

Bytes meshBytes(const Mesh& mesh) {
  return savedBytes([&](rt::StateWriter& writer) { exchangeMesh(writer, mesh); });
}

bool loadMesh(std::span<const std::uint8_t> bytes, Mesh& mesh) {
  rt::StateReader reader(bytes);
  exchangeMesh(reader, mesh);
  return reader.ok() && reader.left() == 0;
}

Bytes tileBytes(const TexturedTile& tile) {
  return savedBytes([&](rt::StateWriter& writer) { exchangeTile(writer, tile); });
}

bool loadTile(std::span<const std::uint8_t> bytes, TexturedTile& tile) {
  rt::StateReader reader(bytes);
  exchangeTile(reader, tile);
  return reader.ok() && reader.left() == 0;
}

}  // namespace fathom::topside
