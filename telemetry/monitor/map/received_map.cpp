#include "telemetry/monitor/map/received_map.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

namespace fathom::monitor {

using telemetry::BlockKey;
using telemetry::MapBlock;

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

bool ReceivedMap::takePacket(std::span<const std::uint8_t> payload, telemetry::Version version,
                             std::int64_t utc_ns) {
  if (!decoder_.decode(payload, packet_)) return false;
  ++packets_;
  for (const MapBlock& block : packet_.blocks)
    store_.put(block, {version, packet_.max_error, packet_.has_colour, utc_ns});
  return true;
}

void ReceivedMap::forgetBefore(telemetry::Version version) {
  store_.forgetBefore(version);
  revisions_.clear();
  places_.clear();
}

void ReceivedMap::takeTile(const telemetry::DecodedTile& decoded, telemetry::Version version,
                           std::int64_t utc_ns) {
  const HeightTile& tile = decoded.tile;
  const TilePlace place{tile.level, tile.north_index, tile.east_index};
  const auto revision = static_cast<std::uint16_t>(tile.revision);
  const auto [known, is_new] = revisions_.try_emplace(place, revision);
  if (is_new) {
    places_.push_back(place);
    if (places_.size() > kMaxTilePlaces) {
      revisions_.erase(places_.front());
      places_.pop_front();
    }
  } else if (known->second != revision) {
    if (!telemetry::newerRevision(revision, known->second)) return;
    known->second = revision;
  }
  const auto code = telemetry::spacingCode(tile.spacing() * decoded.stride);
  // A tile's last row and column belong to its neighbours.
  const int side = HeightTile::kCells / decoded.stride;
  std::map<BlockKey, MapBlock> blocks;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      const std::int64_t n = std::int64_t{tile.north_index} * side + i,
                         e = std::int64_t{tile.east_index} * side + j;
      const BlockKey key{code.value_or(kCoarsestCode + 1), static_cast<std::int32_t>(n >> 2),
                         static_cast<std::int32_t>(e >> 2)};
      const auto [at, fresh] = blocks.try_emplace(key);
      MapBlock& block = at->second;
      if (fresh) {
        const StoredBlock* stored = store_.find(key);
        if (stored != nullptr) block = stored->block;
        block.key = key;
      }
      const auto node = static_cast<std::size_t>((n & 3) * MapBlock::kSide + (e & 3));
      const HeightTile::Node& from = tile.at(i * decoded.stride, j * decoded.stride);
      const auto bit = static_cast<std::uint16_t>(1U << node);
      block.seen = static_cast<std::uint16_t>(from.coverage > 0 ? block.seen | bit : block.seen & ~bit);
      if (from.coverage <= 0) continue;
      block.depth[node] = from.depth;
      block.colour[node] = from.colour;
      block.sigma = from.sigma;
    }
  }
  for (const auto& [key, block] : blocks)
    if (block.seen != 0)
      store_.put(block, {version, decoded.depth_resolution / 2, decoded.colour_bits > 0, utc_ns});
}

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
