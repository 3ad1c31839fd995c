#include "telemetry/monitor/map/chunk_stream.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace fathom::monitor {
namespace {

constexpr std::uint8_t kHasColour = 1, kInterpolated = 2;
constexpr std::size_t kNarrowIndices = 65535;

void pad(std::string& out) {
  out.resize((out.size() + 3) / 4 * 4);
}

std::uint16_t millimetres(double metres) {
  return static_cast<std::uint16_t>(std::lround(std::clamp(metres * 1e3, 0.0, 65535.0)));
}

float secondsSince(std::int64_t base_ns, std::int64_t utc_ns) {
  return static_cast<float>(static_cast<double>(utc_ns - base_ns) * 1e-9);
}

std::int8_t unitByte(float component) {
  return static_cast<std::int8_t>(std::lround(component * 127));
}

void appendChunk(std::string& out, ChunkKey key, const ChunkMesh& mesh, std::int64_t base_utc_ns) {
  appendBytes(out, key.north);
  appendBytes(out, key.east);
  appendBytes(out, static_cast<std::uint32_t>(mesh.vertices.size()));
  appendBytes(out, static_cast<std::uint32_t>(mesh.triangles.size()));
  appendBytes(out, static_cast<float>(mesh.area));
  appendBytes(out, std::uint32_t{0});
  for (const auto& v : mesh.vertices) {
    appendBytes(out, v.north);
    appendBytes(out, v.east);
  }
  for (const auto& v : mesh.vertices) appendBytes(out, static_cast<float>(v.point.depth));
  for (const auto& v : mesh.vertices) {
    appendBytes(out, unitByte(v.normal[0]));
    appendBytes(out, unitByte(v.normal[1]));
    appendBytes(out, unitByte(-v.normal[2]));
    appendBytes(out, static_cast<std::uint8_t>(v.point.spacing));
  }
  for (const auto& v : mesh.vertices) {
    for (const double channel : v.point.colour)
      appendBytes(out, static_cast<std::uint8_t>(std::lround(channel)));
    appendBytes(out, static_cast<std::uint8_t>((v.point.has_colour ? kHasColour : 0) |
                                               (v.point.interpolated ? kInterpolated : 0)));
  }
  for (const auto& v : mesh.vertices) {
    appendBytes(out, millimetres(v.point.sigma));
    appendBytes(out, millimetres(v.point.max_error));
  }
  for (const auto& v : mesh.vertices) {
    appendBytes(out, secondsSince(base_utc_ns, v.point.received_utc_ns));
    appendBytes(out, v.point.changed_utc_ns == 0 ? std::numeric_limits<float>::quiet_NaN()
                                                 : secondsSince(base_utc_ns, v.point.changed_utc_ns));
  }
  const bool narrow = mesh.vertices.size() <= kNarrowIndices;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle)
      if (narrow)
        appendBytes(out, static_cast<std::uint16_t>(corner));
      else
        appendBytes(out, corner);
  pad(out);
}

}  // namespace

std::string mapBinary(const BlockStore& store, Surface& surface, std::uint64_t since,
                      std::int64_t base_utc_ns) {
  std::vector<std::pair<std::uint64_t, ChunkKey>> changed;
  for (const auto& [key, chunk] : store.chunks())
    if (chunk->version > since) changed.emplace_back(chunk->version, key);
  std::sort(changed.begin(), changed.end());

  std::string out = "FMAP";
  appendBytes(out, std::uint32_t{0});
  appendBytes(out, std::uint32_t{0});
  appendBytes(out, std::uint32_t{0});
  appendBytes(out, static_cast<double>(base_utc_ns) * 1e-9);
  std::uint32_t count = 0;
  auto version = static_cast<std::uint32_t>(store.version());
  for (std::size_t i = 0; i < changed.size(); ++i) {
    // Chunks that one block changed have one version and must be sent together.
    if (out.size() > kMaxStreamBytes && changed[i].first != changed[i - 1].first) {
      version = static_cast<std::uint32_t>(changed[i - 1].first);
      break;
    }
    appendChunk(out, changed[i].second, surface.mesh(changed[i].second), base_utc_ns);
    ++count;
  }
  std::memcpy(out.data() + 4, &version, sizeof version);
  std::memcpy(out.data() + 8, &count, sizeof count);
  return out;
}

}  // namespace fathom::monitor
