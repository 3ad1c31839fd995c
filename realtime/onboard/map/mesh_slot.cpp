#include "realtime/onboard/map/mesh_slot.hpp"

#include <array>
#include <bit>
#include <cstring>
#include <limits>

namespace fathom::onboard {
namespace {

static_assert(std::endian::native == std::endian::little, "slots are copies of memory");

constexpr std::uint32_t kMagic = 0x314D4C46;  // "FLM1"
struct Header {
  std::uint32_t magic = kMagic;
  std::uint16_t vertices = 0, zero = 0;
  std::uint32_t triangles = 0;
};
using Corner = std::array<float, 4>;
using Triangle = std::array<std::uint16_t, 3>;
constexpr std::size_t kVertexBytes = sizeof(Corner) + sizeof(Rgb);
static_assert(sizeof(Header) == 12 && sizeof(Triangle) == 6 && sizeof(Rgb) == 3);

std::size_t slotBytesFor(std::size_t vertices, std::size_t triangles) {
  return sizeof(Header) + vertices * kVertexBytes + triangles * sizeof(Triangle);
}

template <typename T>
std::uint8_t* put(std::uint8_t* to, const T& value) {
  std::memcpy(to, &value, sizeof(T));
  return to + sizeof(T);
}

template <typename T>
const std::uint8_t* take(const std::uint8_t* from, T& value) {
  std::memcpy(&value, from, sizeof(T));
  return from + sizeof(T);
}

}  // namespace

std::size_t meshSlotBytes(std::size_t max_points) {
  return slotBytesFor(max_points, 2 * max_points);
}

std::size_t writeMeshSlot(const Mesh& mesh, std::span<std::uint8_t> slot) {
  const std::size_t vertices = mesh.vertices.size(), bytes = slotBytesFor(vertices, mesh.triangles.size());
  if (vertices > std::numeric_limits<std::uint16_t>::max() || bytes > slot.size() ||
      mesh.sigma.size() != vertices || mesh.colours.size() != vertices)
    return 0;
  Header header;
  header.vertices = static_cast<std::uint16_t>(vertices);
  header.triangles = static_cast<std::uint32_t>(mesh.triangles.size());
  std::uint8_t* to = put(slot.data(), header);
  for (std::size_t i = 0; i < vertices; ++i) {
    const Eigen::Vector3f& v = mesh.vertices[i];
    to = put(to, Corner{v.x(), v.y(), v.z(), mesh.sigma[i]});
  }
  for (const auto& t : mesh.triangles)
    to = put(to, Triangle{static_cast<std::uint16_t>(t[0]), static_cast<std::uint16_t>(t[1]),
                          static_cast<std::uint16_t>(t[2])});
  for (const Rgb& c : mesh.colours) to = put(to, c);
  return bytes;
}

bool readMeshSlot(std::span<const std::uint8_t> slot, Mesh& mesh) {
  mesh.vertices.clear();
  mesh.normals.clear();
  mesh.colours.clear();
  mesh.texture_coordinates.clear();
  mesh.sigma.clear();
  mesh.triangles.clear();
  Header header;
  if (slot.size() < sizeof(Header)) return false;
  const std::uint8_t* from = take(slot.data(), header);
  if (header.magic != kMagic || slotBytesFor(header.vertices, header.triangles) > slot.size()) return false;
  for (std::size_t i = 0; i < header.vertices; ++i) {
    Corner c;
    from = take(from, c);
    mesh.vertices.emplace_back(c[0], c[1], c[2]);
    mesh.sigma.push_back(c[3]);
  }
  for (std::size_t i = 0; i < header.triangles; ++i) {
    Triangle t;
    from = take(from, t);
    mesh.triangles.push_back({t[0], t[1], t[2]});
  }
  for (std::size_t i = 0; i < header.vertices; ++i) {
    Rgb c;
    from = take(from, c);
    mesh.colours.push_back(c);
  }
  return true;
}

}  // namespace fathom::onboard
