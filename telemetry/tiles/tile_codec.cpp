#include "telemetry/tiles/tile_codec.hpp"

#include <draco/compression/decode.h>
#include <draco/point_cloud/point_cloud.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <vector>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {
namespace {

// What every stream begins with in Draco's bitstream 2.3: magic, version, point cloud, sequential, no flags;
// number of points (u32, little-endian, at kPointsAt); one decoder of one attribute: generic, int16,
// components (at kComponentsAt), not normalised, id 0, integer coder; difference prediction, wrap transform,
// compressed.
constexpr std::size_t kPointsAt = 11;
constexpr std::size_t kComponentsAt = 19;
using Prefix = std::array<std::uint8_t, 26>;

Prefix prefix(std::size_t points, int components) {
  Prefix p{'D', 'R', 'A', 'C', 'O', 2, 3, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 4, 3, 0, 0, 0, 1, 0, 1, 1};
  writeLittleEndian(std::span(p).subspan(kPointsAt, 4), points);
  p[kComponentsAt] = static_cast<std::uint8_t>(components);
  return p;
}

// Every stream ends with the wrap transform's bounds, two int32. The lesser is 0 as sent; of the greater 16
// bits go.
constexpr std::size_t kBoundsBytes = 8;
constexpr std::size_t kSentBoundBytes = 2;

bool decodeCloud(std::span<const std::uint8_t> bytes, int components, std::span<std::int16_t> values) {
  const std::size_t points = values.size() / static_cast<std::size_t>(components);
  const Prefix head = prefix(points, components);
  std::vector<char> stream(head.begin(), head.end());
  stream.insert(stream.end(), bytes.begin() + kSentBoundBytes, bytes.end());
  stream.insert(stream.end(), 4, 0);
  stream.insert(stream.end(), {static_cast<char>(bytes[0]), static_cast<char>(bytes[1]), 0, 0});
  draco::DecoderBuffer buffer;
  buffer.Init(stream.data(), stream.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodePointCloudFromBuffer(&buffer);
  if (!decoded.ok() || buffer.remaining_size() != 0) return false;
  const draco::PointCloud& cloud = *decoded.value();
  if (cloud.num_attributes() != 1 || cloud.num_points() != points) return false;
  const draco::PointAttribute& attribute = *cloud.attribute(0);
  if (attribute.size() != points || attribute.num_components() != components ||
      attribute.data_type() != draco::DT_INT16)
    return false;
  for (std::size_t k = 0; k < points; ++k)
    attribute.GetValue(draco::AttributeValueIndex(static_cast<std::uint32_t>(k)),
                       values.data() + k * static_cast<std::size_t>(components));
  return std::all_of(values.begin(), values.end(), [](std::int16_t v) { return v >= 0; });
}

// An encoded tile: size [mm], stride, resolution [mm], colour bits, sigma code, least depth in steps, mask of
// nodes; then, from the next byte on, Draco's values per seen node along the walk: depth above the least and,
// with colour, luma and two chroma differences. Depths are rounded on a grid through zero, so that the nodes
// which neighbouring tiles share come out equal and the tiles join.
constexpr Field kSize{1, 1048575, 1};     // [mm]
constexpr Field kResolution{1, 1000, 1};  // [mm]
constexpr unsigned kColourBits = 3;
constexpr int kMaxColourBits = 6;    // of brightness, one more of each chroma
constexpr unsigned kDepthBits = 24;  // signed
constexpr unsigned kSigmaBits = 6;
constexpr double kSigmaFloor = 0.001;  // code 0 [m]; each step is a quarter of an octave, the last is 55 m
constexpr double kSigmaSteps = 4;      // per octave

struct Lattice {
  explicit Lattice(int step) : stride(step), side(HeightTile::kCells / step + 1) {}
  int stride;
  int side;  // nodes per side
  [[nodiscard]] std::size_t count() const { return static_cast<std::size_t>(side * side); }
  // The k-th node of the walk: row by row, every second row backwards, so that the next node is a neighbour.
  [[nodiscard]] std::size_t node(std::size_t k) const {
    const int row = static_cast<int>(k) / side;
    const int step = static_cast<int>(k) % side;
    const int column = row % 2 == 0 ? step : side - 1 - step;
    return static_cast<std::size_t>(row * stride * HeightTile::kSide + column * stride);
  }
};

// Luma in 2^bits steps, and two chroma differences (YCoCg) in steps half as large, all offset to positive
// numbers. Underwater chroma is small, so its steps must be finer to keep any hue; it hardly changes from
// node to node and costs little.
constexpr int kChromaFiner = 2;

Rgb fromLuma(const std::int16_t* code, int bits) {
  const int range = (1 << bits) - 1;
  const double scale = 255.0 / range, chroma = scale / kChromaFiner;
  const int offset = range * kChromaFiner;
  const double y = code[0] * scale, co = (code[1] - offset) * chroma, cg = (code[2] - offset) * chroma;
  const auto channel = [](double v) {
    return static_cast<std::uint8_t>(std::lround(std::clamp(v, 0.0, 255.0)));
  };
  return {channel(y - cg + co), channel(y + cg), channel(y - cg - co)};
}

// Reads which nodes of a lattice were seen, in the order of a walk over it: one bit for a full lattice;
// otherwise one bit a node or run lengths (Elias gamma, first run unseen, may be empty). False if the bits
// are no mask of seen.size() nodes.
bool getMask(BitReader& reader, std::span<bool> seen) {
  if (reader.get(1) == 1) {
    std::fill(seen.begin(), seen.end(), true);
    return reader.ok();
  }
  if (reader.get(1) == 0) {
    for (bool& s : seen) s = reader.get(1) == 1;
    return reader.ok();
  }
  bool value = false;
  for (std::size_t i = 0; i < seen.size(); value = !value) {
    unsigned zeros = 0;
    while (reader.ok() && reader.get(1) == 0 && ++zeros < 16) {
    }
    if (!reader.ok() || zeros >= 16) return false;
    const std::size_t length = (std::size_t{1} << zeros | reader.get(zeros)) - 1;
    if (!reader.ok() || length > seen.size() - i || (length == 0 && i > 0)) return false;
    std::fill_n(seen.begin() + static_cast<std::ptrdiff_t>(i), length, value);
    i += length;
  }
  return true;
}

constexpr unsigned kLevelBits = 4;
constexpr unsigned kIndexBits = 15;  // signed
constexpr unsigned kFragmentBits = 7;
static_assert(kLevelBits + 2 * kIndexBits + kRevisionBits + kStrideBits + 2 * kFragmentBits ==
              8 * kFragmentHeaderBytes);

}  // namespace

bool decodeValues(std::span<const std::uint8_t> bytes, int components, std::span<std::int16_t> values) {
  if (components < 1 || components > kMaxDracoComponents || bytes.size() < kSentBoundBytes) return false;
  const auto width = static_cast<std::size_t>(components);
  if (values.empty() || values.size() % width != 0 || values.size() / width > kMaxDracoPoints) return false;
  try {
    return decodeCloud(bytes, components, values);
  } catch (const std::exception&) {  // out of memory, or a length that Draco did not check
    return false;
  }
}

bool decodeTile(std::span<const std::uint8_t> bytes, DecodedTile& out) {
  if (bytes.size() > kMaxTileBytes) return false;
  BitReader r(bytes);
  DecodedTile decoded;
  decoded.tile.north_index = out.tile.north_index;
  decoded.tile.east_index = out.tile.east_index;
  decoded.tile.level = out.tile.level;
  decoded.tile.revision = out.tile.revision;
  decoded.tile.size = r.get(kSize) / 1000;
  decoded.stride = 1 << r.get(kStrideBits);
  decoded.depth_resolution = r.get(kResolution) / 1000;
  decoded.colour_bits = static_cast<int>(r.get(kColourBits));
  const float sigma =
      static_cast<float>(kSigmaFloor * powerOfTwo(static_cast<double>(r.get(kSigmaBits)) / kSigmaSteps));
  const std::int64_t least = r.getSigned(kDepthBits);
  const Lattice lattice(decoded.stride);
  std::array<bool, HeightTile::kNodes> seen{};
  if (!r.ok() || decoded.colour_bits > kMaxColourBits || !getMask(r, std::span(seen).first(lattice.count())))
    return false;
  const auto count = static_cast<std::size_t>(std::count(seen.begin(), seen.end(), true));
  const std::size_t components = decoded.colour_bits > 0 ? 4 : 1;
  std::array<std::int16_t, kMaxDracoComponents * HeightTile::kNodes> values{};
  if (count == 0 || !decodeValues(bytes.subspan(r.bytes()), static_cast<int>(components),
                                  std::span(values).first(count * components)))
    return false;

  const int range = (1 << decoded.colour_bits) - 1;
  const std::int16_t* value = values.data();
  for (std::size_t k = 0; k < lattice.count(); ++k) {
    if (!seen[k]) continue;
    HeightTile::Node& node = decoded.tile.nodes[lattice.node(k)];
    node.depth = static_cast<float>(static_cast<double>(least + value[0]) * decoded.depth_resolution);
    node.sigma = sigma;
    node.coverage = 1;
    if (components == 4) {
      const int chroma = 2 * range * kChromaFiner;
      if (value[1] > range || value[2] > chroma || value[3] > chroma) return false;
      node.colour = fromLuma(value + 1, decoded.colour_bits);
    }
    value += components;
  }
  out = decoded;
  return true;
}

bool decodeFragment(std::span<const std::uint8_t> payload, TileFragment& out) {
  if (payload.size() <= kFragmentHeaderBytes || payload.size() > kFragmentHeaderBytes + kMaxPieceBytes)
    return false;
  BitReader r(payload.first(kFragmentHeaderBytes));
  out.id.level = static_cast<int>(r.get(kLevelBits));
  out.id.north_index = static_cast<std::int32_t>(r.getSigned(kIndexBits));
  out.id.east_index = static_cast<std::int32_t>(r.getSigned(kIndexBits));
  out.id.revision = static_cast<std::uint16_t>(r.get(kRevisionBits));
  out.id.stride = 1 << r.get(kStrideBits);
  out.index = static_cast<int>(r.get(kFragmentBits));
  out.count = static_cast<int>(r.get(kFragmentBits));
  out.piece = payload.subspan(kFragmentHeaderBytes);
  return out.index < out.count;
}

bool newerRevision(std::uint16_t a, std::uint16_t b) {
  constexpr unsigned kMask = (1U << kRevisionBits) - 1;
  const unsigned ahead = (static_cast<unsigned>(a) - b) & kMask;
  return ahead != 0 && ahead < 1U << (kRevisionBits - 1);
}

TileReassembler::TileReassembler(int open_tiles)
    : slots_(static_cast<std::size_t>(std::max(open_tiles, 1))) {}

int TileReassembler::open() const {
  return static_cast<int>(
      std::count_if(slots_.begin(), slots_.end(), [](const Slot& s) { return s.used && !s.finished; }));
}

TileReassembler::Slot& TileReassembler::slotFor(const TileFragment& fragment) {
  for (Slot& slot : slots_) {
    if (slot.used && slot.id == fragment.id) return slot;
    const bool older = slot.used && !slot.finished && slot.id.sameTile(fragment.id) &&
                       slot.id.stride == fragment.id.stride &&
                       newerRevision(fragment.id.revision, slot.id.revision);
    if (older) {
      slot.used = false;
      ++counters_.superseded;
    }
  }
  // Free first, then the finished or open tile that was touched longest ago.
  const auto rank = [](const Slot& s) { return !s.used ? 0 : s.finished ? 1 : 2; };
  Slot& slot = *std::min_element(slots_.begin(), slots_.end(), [&](const Slot& a, const Slot& b) {
    return rank(a) != rank(b) ? rank(a) < rank(b) : a.touched < b.touched;
  });
  if (slot.used && !slot.finished) ++counters_.evicted;
  slot.used = true;
  slot.finished = false;
  slot.id = fragment.id;
  slot.count = fragment.count;
  slot.have = 0;
  slot.present.fill(false);
  return slot;
}

bool TileReassembler::accept(std::span<const std::uint8_t> payload, DecodedTile& out) {
  TileFragment fragment;
  if (!decodeFragment(payload, fragment)) {
    ++counters_.invalid;
    return false;
  }
  ++counters_.fragments;
  Slot& slot = slotFor(fragment);
  slot.touched = ++clock_;
  if (slot.count != fragment.count) {
    ++counters_.conflicting;
    return false;
  }
  const auto index = static_cast<std::size_t>(fragment.index);
  if (slot.finished || slot.present[index]) {
    ++counters_.repeated;
    return false;
  }
  slot.present[index] = true;
  slot.length[index] = static_cast<std::uint8_t>(fragment.piece.size());
  std::copy(fragment.piece.begin(), fragment.piece.end(),
            slot.bytes.begin() + static_cast<std::ptrdiff_t>(index * kMaxPieceBytes));
  if (++slot.have < slot.count) return false;
  return assemble(slot, out);
}

bool TileReassembler::assemble(Slot& slot, DecodedTile& out) {
  std::array<std::uint8_t, kMaxTileBytes> bytes;
  std::size_t size = 0;
  const auto count = static_cast<std::size_t>(slot.count);
  slot.finished = true;
  for (std::size_t i = 0; i < count; ++i) {
    const bool even = i + 1 < count ? slot.length[i] == slot.length[0] : slot.length[i] <= slot.length[0];
    if (!even || size + slot.length[i] > bytes.size()) {
      ++counters_.conflicting;
      slot.used = false;  // a later repetition may put it right
      return false;
    }
    std::copy_n(slot.bytes.begin() + static_cast<std::ptrdiff_t>(i * kMaxPieceBytes), slot.length[i],
                bytes.begin() + static_cast<std::ptrdiff_t>(size));
    size += slot.length[i];
  }
  DecodedTile decoded;
  decoded.tile.north_index = slot.id.north_index;
  decoded.tile.east_index = slot.id.east_index;
  decoded.tile.level = static_cast<std::int16_t>(slot.id.level);
  decoded.tile.revision = slot.id.revision;
  if (!decodeTile(std::span(bytes).first(size), decoded) || decoded.stride != slot.id.stride) {
    ++counters_.undecodable;
    slot.used = false;
    return false;
  }
  ++counters_.completed;
  out = decoded;
  return true;
}

}  // namespace fathom::telemetry
