#include "telemetry/tiles/tile_codec.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"
#include "telemetry/tiles/draco_values.hpp"
#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {
namespace {

// An encoded tile: size [mm], stride, resolution [mm], colour bits, sigma code, least depth in steps, mask of
// nodes; then, from the next byte on, Draco's values per seen node along the walk: depth above the least and,
// with colour, luma and two chroma differences. Depths are rounded on a grid through zero, so that the nodes
// which neighbouring tiles share come out equal and the tiles join.
constexpr Field kSize{1, kMaxTileSize_mm, 1};
constexpr Field kResolution{1, 1000, 1};  // [mm]
constexpr unsigned kColourBits = 3;
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

std::array<std::int16_t, 3> toLuma(const Rgb& colour, int bits) {
  const int range = (1 << bits) - 1;
  const auto quantise = [&](double v, int finer) {
    return static_cast<std::int16_t>(std::lround(v * range * finer / 255.0));
  };
  const auto offset = static_cast<std::int16_t>(range * kChromaFiner);
  const double r = colour[0], g = colour[1], b = colour[2];
  return {quantise((r + 2 * g + b) / 4, 1),
          static_cast<std::int16_t>(quantise((r - b) / 2, kChromaFiner) + offset),
          static_cast<std::int16_t>(quantise((2 * g - r - b) / 4, kChromaFiner) + offset)};
}

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

std::uint64_t sigmaQuarterOctave(float sigma) {
  if (!(sigma > kSigmaFloor)) return 0;
  return static_cast<std::uint64_t>(
      std::clamp(std::lround(kSigmaSteps * std::log2(sigma / kSigmaFloor)), 0L, (1L << kSigmaBits) - 1));
}

// log2 of a stride of 1, 2, 4 or 8; -1 for any other.
int strideCode(int stride) {
  return stride >= 1 && stride <= 8 && std::has_single_bit(static_cast<unsigned>(stride))
             ? std::countr_zero(static_cast<unsigned>(stride))
             : -1;
}

unsigned gammaBits(std::size_t value) {
  return 2 * static_cast<unsigned>(std::bit_width(value)) - 1;
}

// Calls visit(length) for each run; lengths are of unseen, seen, unseen, ... nodes, the first may be 0.
template <class Visit>
void forEachRun(std::span<const bool> seen, Visit visit) {
  bool value = false;
  std::size_t begin = 0;
  for (std::size_t i = 0; i <= seen.size(); ++i) {
    if (i < seen.size() && seen[i] == value) continue;
    visit(i - begin);
    begin = i;
    value = !value;
  }
}

// Which nodes of a lattice were seen, in the order of a walk over it. A full lattice costs one bit; otherwise
// the shorter of one bit a node and run lengths (Elias gamma, first run unseen, may be empty).
void putMask(BitWriter& writer, std::span<const bool> seen) {
  const bool full = std::all_of(seen.begin(), seen.end(), [](bool s) { return s; });
  writer.put(full ? 1 : 0, 1);
  if (full) return;
  std::size_t run_bits = 0;
  forEachRun(seen, [&](std::size_t length) { run_bits += gammaBits(length + 1); });
  const bool runs = run_bits < seen.size();
  writer.put(runs ? 1 : 0, 1);
  if (!runs) {
    for (const bool s : seen) writer.put(s ? 1 : 0, 1);
    return;
  }
  forEachRun(seen, [&](std::size_t length) {
    const unsigned width = static_cast<unsigned>(std::bit_width(length + 1));
    writer.put(0, width - 1);
    writer.put(length + 1, width);
  });
}

// Reads a mask of seen.size() nodes; false if the bits are not one.
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

}  // namespace

void TileCodecConfig::validate() const {
  if (!(depth_resolution >= 0.001 && depth_resolution <= 1))
    throw std::invalid_argument("depth_resolution is outside 0.001 to 1 m");
  if (colour_bits < 0 || colour_bits > kMaxColourBits)
    throw std::invalid_argument("colour_bits is outside 0 to 6");
  if (!(min_coverage >= 0 && min_coverage <= 1))
    throw std::invalid_argument("min_coverage is outside 0 to 1");
}

std::size_t encodeTile(const HeightTile& tile, int stride, const TileCodecConfig& config,
                       std::span<std::uint8_t> out) {
  const double size_mm = tile.size * 1000;
  const double resolution_mm = std::round(config.depth_resolution * 1000);
  if (strideCode(stride) < 0 || !kSize.valid(size_mm) || std::abs(size_mm - std::round(size_mm)) > 1e-6 ||
      !kResolution.valid(resolution_mm) || config.colour_bits < 0 || config.colour_bits > kMaxColourBits)
    return 0;
  const Lattice lattice(stride);
  std::array<bool, HeightTile::kNodes> seen{};
  std::array<std::int64_t, HeightTile::kNodes> steps{};
  std::array<float, HeightTile::kNodes> sigmas{};
  std::size_t count = 0;
  std::int64_t least = std::numeric_limits<std::int64_t>::max(),
               greatest = std::numeric_limits<std::int64_t>::min();
  for (std::size_t k = 0; k < lattice.count(); ++k) {
    const HeightTile::Node& node = tile.nodes[lattice.node(k)];
    const double step = node.depth * 1000.0 / resolution_mm;
    seen[k] =
        node.coverage > 0 && node.coverage >= config.min_coverage && std::abs(step) < 1 << (kDepthBits - 1);
    if (!seen[k]) continue;
    steps[k] = std::llround(step);
    least = std::min(least, steps[k]);
    greatest = std::max(greatest, steps[k]);
    sigmas[count++] = node.sigma;
  }
  const std::int64_t depth_bound = std::int64_t{1} << (kDepthBits - 1);
  if (count == 0 || greatest - least > std::numeric_limits<std::int16_t>::max() || least < -depth_bound ||
      least >= depth_bound)
    return 0;

  BitWriter w(out);
  w.put(kSize, size_mm);
  w.put(static_cast<std::uint64_t>(strideCode(stride)), kStrideBits);
  w.put(kResolution, resolution_mm);
  w.put(static_cast<std::uint64_t>(config.colour_bits), kColourBits);
  w.put(sigmaQuarterOctave(median(std::span(sigmas).first(count))), kSigmaBits);
  w.putSigned(least, kDepthBits);
  putMask(w, std::span(seen).first(lattice.count()));
  if (!w.ok()) return 0;

  const std::size_t components = config.colour_bits > 0 ? 4 : 1;
  std::array<std::int16_t, kMaxDracoComponents * HeightTile::kNodes> values{};
  std::size_t n = 0;
  for (std::size_t k = 0; k < lattice.count(); ++k) {
    if (!seen[k]) continue;
    values[n++] = static_cast<std::int16_t>(steps[k] - least);
    if (components == 1) continue;
    for (const std::int16_t v : toLuma(tile.nodes[lattice.node(k)].colour, config.colour_bits))
      values[n++] = v;
  }
  const std::size_t body =
      encodeValues(std::span(values).first(n), static_cast<int>(components), out.subspan(w.bytes()));
  return body == 0 ? 0 : w.bytes() + body;
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
      static_cast<float>(kSigmaFloor * std::exp2(static_cast<double>(r.get(kSigmaBits)) / kSigmaSteps));
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

}  // namespace fathom::telemetry
