#include "telemetry/map/map_packet.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "telemetry/map/map_packet_walk.hpp"

namespace fathom::telemetry {
namespace {

using packet::Header;
using packet::kUnitsPerStep;
using packet::Patch;

constexpr double kLeastSigma = 0.02;  // code 0 [m]; each code doubles

// One unit [m]. A height is rounded to units before it is rounded to steps: half a unit of the error bound is
// kept for that.
double unitOf(int error_code) {
  return packet::errorOf(error_code) / (0.5 * (kUnitsPerStep + 1));
}
double sigmaOf(int code) {
  return std::ldexp(kLeastSigma, code);
}
int sigmaCode(double sigma) {
  int code = 0;
  while (code < packet::kSigmaCodes - 1 && sigmaOf(code) < sigma) ++code;
  return code;
}
// The largest error that has a code and is not above max_error; -1 if none is.
int errorCode(double max_error) {
  int code = -1;
  while (code + 1 < packet::kErrorCodes && packet::errorOf(code + 1) <= max_error * (1 + 1e-9)) ++code;
  return code;
}

struct Content {
  Patch patch;
  std::array<std::int32_t, Patch::kGrid> wanted{};  // heights, in the encoder [units above the base]
  std::array<std::int32_t, Patch::kGrid> height{};  // as decoded
  packet::Colours colours;
  std::int64_t activity = 0;  // mean over the packet
};

template <class Coder>
bool codeBody(Coder& coder, const Header& header, Content& content, packet::KrigingTable& table) {
  Patch& patch = content.patch;
  patch.forget();
  if (!packet::codeBlocks(coder, patch, kMaxPacketBlocks)) return false;
  packet::codeSeen(coder, patch);
  content.activity = 0;
  if (patch.first() < 0) return true;  // nothing of these blocks is seen any more
  packet::FieldWalk<Coder> heights(coder, patch, table, header.roughness, content.wanted.data());
  heights.run();
  content.activity = heights.meanActivity();
  std::copy_n(patch.value.begin(), patch.used(), content.height.begin());
  if (header.colour_bits > 0) packet::codeColours(coder, patch, table, content.colours);
  return true;
}

void takeBlock(const Content& content, const Header& h, int r, int c, MapBlock& block) {
  const double unit = unitOf(h.error_code);
  block = MapBlock{};
  block.key = {h.spacing, h.north + r, h.east + c};
  block.sigma = static_cast<float>(sigmaOf(h.sigma_code));
  for (int n = 0; n < MapBlock::kNodes; ++n) {
    const auto at = static_cast<std::size_t>(content.patch.at(r * 4 + n / 4, c * 4 + n % 4));
    if (content.patch.state[at] != Patch::kKnown) continue;
    const auto k = static_cast<std::size_t>(n);
    block.seen = static_cast<std::uint16_t>(block.seen | 1U << n);
    block.depth[k] = static_cast<float>(
        static_cast<double>(std::int64_t{h.base} * kUnitsPerStep + content.height[at]) * unit);
    if (h.colour_bits > 0) block.colour[k] = packet::shownColour(content.colours, at, h.colour_bits);
  }
}

}  // namespace

struct MapPacketDecoder::Impl {
  Header header;
  Content content;
  packet::KrigingTable table;

  bool decode(std::span<const std::uint8_t> payload) {
    if (payload.empty()) return false;
    RangeDecoder coder(payload);
    if (!packet::codeHeader(coder, header)) return false;
    content.patch.shape(header.rows, header.cols);
    return codeBody(coder, header, content, table) && coder.overrun() <= 4;
  }
};

MapPacketDecoder::MapPacketDecoder() : impl_(std::make_unique<Impl>()) {}
MapPacketDecoder::~MapPacketDecoder() = default;

bool MapPacketDecoder::decode(std::span<const std::uint8_t> payload, DecodedMapPacket& out) {
  if (!impl_->decode(payload)) return false;
  const Header& h = impl_->header;
  out.spacing = h.spacing;
  out.max_error = packet::errorOf(h.error_code);
  out.has_colour = h.colour_bits > 0;
  out.blocks.clear();
  out.blocks.reserve(kMaxPacketBlocks);
  for (int r = 0; r < h.rows; ++r)
    for (int c = 0; c < h.cols; ++c)
      if (impl_->content.patch.has(r, c)) takeBlock(impl_->content, h, r, c, out.blocks.emplace_back());
  return true;
}

struct MapPacketEncoder::Impl {
  Content content;
  Header header;
  MapPacketDecoder::Impl check;
  std::array<std::uint8_t, 4096> scratch{};
  MapBlock partial;                          // the nodes sent of a block that did not fit
  std::array<double, Patch::kGrid> exact{};  // heights wanted [units]

  // Number of leading blocks that fit one rectangle of a packet.
  static std::size_t reach(std::span<const MapBlock> blocks) {
    std::int64_t n0 = 0, n1 = 0, e0 = 0, e1 = 0;
    for (std::size_t k = 0; k < std::min(blocks.size(), kMaxPacketBlocks); ++k) {
      const BlockKey& key = blocks[k].key;
      if (key.spacing != blocks[0].key.spacing || std::abs(std::int64_t{key.north}) >= packet::kMaxKey ||
          std::abs(std::int64_t{key.east}) >= packet::kMaxKey)
        return k;
      n0 = k == 0 ? key.north : std::min<std::int64_t>(n0, key.north);
      n1 = k == 0 ? key.north : std::max<std::int64_t>(n1, key.north);
      e0 = k == 0 ? key.east : std::min<std::int64_t>(e0, key.east);
      e1 = k == 0 ? key.east : std::max<std::int64_t>(e1, key.east);
      const std::int64_t rows = n1 - n0 + 1, cols = e1 - e0 + 1;
      if (rows > packet::kMaxSide || cols > packet::kMaxSide || rows * cols > packet::kMaxRectangle) return k;
    }
    return std::min(blocks.size(), kMaxPacketBlocks);
  }

  // Lays the blocks out as a patch; false if they cannot be sent.
  bool lay(std::span<const MapBlock> blocks, int error_code, int colour_bits) {
    Header& h = header;
    h = Header{};
    h.spacing = blocks[0].key.spacing;
    h.error_code = error_code;
    h.colour_bits = colour_bits;
    h.north = h.east = std::numeric_limits<std::int32_t>::max();
    std::int32_t north = std::numeric_limits<std::int32_t>::min(), east = north;
    double sigma = 0;
    for (const MapBlock& block : blocks) {
      h.north = std::min(h.north, block.key.north);
      h.east = std::min(h.east, block.key.east);
      north = std::max(north, block.key.north);
      east = std::max(east, block.key.east);
      sigma = std::max(sigma, static_cast<double>(block.sigma));
    }
    h.sigma_code = sigmaCode(sigma);
    h.rows = north - h.north + 1;
    h.cols = east - h.east + 1;
    Patch& patch = content.patch;
    patch.shape(h.rows, h.cols);
    const double unit = unitOf(error_code);
    for (const MapBlock& block : blocks) {
      const int r = block.key.north - h.north, c = block.key.east - h.east;
      patch.included[static_cast<std::size_t>(r * h.cols + c)] = true;
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        const auto at = static_cast<std::size_t>(patch.at(r * 4 + n / 4, c * 4 + n % 4));
        const auto k = static_cast<std::size_t>(n);
        patch.state[at] = block.isSeen(n) ? Patch::kSeen : Patch::kUnseen;
        if (!block.isSeen(n)) continue;
        exact[at] = static_cast<double>(block.depth[k]) / unit;
        if (colour_bits > 0) packet::wantColour(content.colours, at, block.colour[k], colour_bits);
      }
    }
    // The base is the first node's depth.
    std::optional<double> base;
    bool good = true;
    for (const packet::Pass& pass : packet::kPasses) {
      patch.visit(pass, [&](int at) {
        const auto n = static_cast<std::size_t>(at);
        if (!base) base = std::round(exact[n] / kUnitsPerStep);
        const double height = exact[n] - *base * kUnitsPerStep;
        good = good && 2 * std::abs(height) < packet::kMaxUnits;  // false for a depth that is not a number
        if (good) content.wanted[n] = static_cast<std::int32_t>(std::lround(height));
      });
    }
    if (!good || !(std::abs(base.value_or(0)) < packet::kMaxBase)) return false;
    h.base = static_cast<std::int32_t>(base.value_or(0));
    return true;
  }

  // Encodes what was laid out; 0 if it does not fit.
  std::size_t write(int roughness, std::span<std::uint8_t> out) {
    header.roughness = roughness;
    // The coder writes some bytes further than it ends.
    RangeEncoder coder(scratch);
    if (!packet::codeHeader(coder, header) || !codeBody(coder, header, content, check.table)) return 0;
    const std::size_t size = std::max<std::size_t>(coder.finish(), 1);
    if (!coder.ok() || size > out.size()) return 0;
    if (out.data() != scratch.data()) std::copy_n(scratch.begin(), size, out.begin());
    return size;
  }
  // At the roughness near to `usual` that gives the fewest bytes, which it leaves in the header.
  std::size_t writeBest(int usual, std::span<std::uint8_t> out) {
    int best = 0;
    std::size_t least = 0;
    const int last = std::min(usual + 1, static_cast<int>(packet::kRoughness.size()) - 1);
    for (int roughness = std::max(usual - 1, 0); roughness <= last; ++roughness) {
      const std::size_t size = write(roughness, out);
      if (size == 0 || (least > 0 && size >= least)) continue;
      least = size;
      best = roughness;
    }
    header.roughness = best;
    return least == 0 ? 0 : write(best, out);
  }

  // The longest prefix that fits, encoded into `out`.
  Result longest(std::span<const MapBlock> blocks, int error_code, int colour_bits,
                 std::span<std::uint8_t> out) {
    std::size_t low = 0, high = reach(blocks) + 1;  // low fits, high does not
    int usual = packet::kUsualRoughness;
    double bytes_per_block = kFirstGuess;
    while (high - low > 1) {
      const auto guess = static_cast<std::size_t>(static_cast<double>(out.size()) / bytes_per_block);
      // Narrows from the guess, then halves.
      const std::size_t n = std::clamp(high - low > 8 ? guess : (low + high) / 2, low + 1, high - 1);
      if (!lay(blocks.first(n), error_code, colour_bits)) {
        high = n;
        continue;
      }
      const std::size_t size = write(usual, scratch);
      usual = nearestRoughness(content.activity);
      const bool fits = size > 0 && size <= out.size();
      if (size > 0)
        bytes_per_block = static_cast<double>(size) / static_cast<double>(n) * (fits ? 0.98 : 1.02);
      (fits ? low : high) = n;
    }
    // The best roughness may make room for a block or two more.
    std::size_t n = std::max<std::size_t>(low, 1);
    if (!lay(blocks.first(n), error_code, colour_bits)) return {};
    Result result{writeBest(usual, out), n};
    if (result.bytes == 0) return {};
    const int best = header.roughness;
    while (n < reach(blocks) && lay(blocks.first(n + 1), error_code, colour_bits) &&
           write(best, std::span(scratch).first(out.size())) > 0)
      ++n;
    if (n == result.blocks) return result;
    (void)lay(blocks.first(n), error_code, colour_bits);
    return {write(best, out), n};
  }
  // As many nodes of one block as fit, coarsest first.
  Result part(const MapBlock& block, int error_code, int colour_bits, std::span<std::uint8_t> out) {
    if (!lay({&block, 1}, error_code, colour_bits)) return {};  // fails for another reason than room
    MapBlock some = block;
    some.seen = 0;
    for (const packet::Pass& pass : packet::kPasses) {
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        if ((pass.nodes >> n & 1) == 0 || !block.isSeen(n)) continue;
        some.seen = static_cast<std::uint16_t>(some.seen | 1U << n);
        if (!lay({&some, 1}, error_code, colour_bits) ||
            writeBest(packet::kUsualRoughness, std::span(scratch).first(out.size())) == 0)
          some.seen = static_cast<std::uint16_t>(some.seen & ~(1U << n));
      }
    }
    if (some.seen == 0) return {};
    (void)lay({&some, 1}, error_code, colour_bits);
    partial = some;
    return {writeBest(packet::kUsualRoughness, out), 1};
  }
  static int nearestRoughness(std::int64_t activity) {
    int best = 0;
    for (int k = 1; k < static_cast<int>(packet::kRoughness.size()); ++k) {
      const auto level = [](int code) { return packet::kRoughness[static_cast<std::size_t>(code)]; };
      if (activity * activity > level(k) * level(k - 1)) best = k;
    }
    return best;
  }
  // Whether the decoded packet keeps the error.
  bool held(std::span<const MapBlock> blocks, double max_error) {
    MapBlock got;
    for (const MapBlock& block : blocks) {
      takeBlock(check.content, check.header, block.key.north - check.header.north,
                block.key.east - check.header.east, got);
      if (got.seen != block.seen) return false;
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        const auto k = static_cast<std::size_t>(n);
        if (block.isSeen(n) &&
            !(std::abs(static_cast<double>(got.depth[k]) - static_cast<double>(block.depth[k])) <= max_error))
          return false;
      }
    }
    return true;
  }
  static constexpr double kFirstGuess = 2.5;  // bytes a block
  static constexpr int kErrorTries = 4;
};

MapPacketEncoder::MapPacketEncoder() : impl_(std::make_unique<Impl>()) {}
MapPacketEncoder::~MapPacketEncoder() = default;

MapPacketEncoder::Result MapPacketEncoder::encode(std::span<const MapBlock> blocks,
                                                  const MapPacketConfig& config, std::span<std::uint8_t> out,
                                                  std::span<MapBlock> decoded) {
  if (blocks.empty() || !(config.max_error > 0)) return {};
  out = out.first(std::min(out.size(), impl_->scratch.size()));
  const int colour_bits = std::clamp(config.colour_bits, 0, packet::kMaxColourBits);
  const int wanted = errorCode(config.max_error);
  // A float near the deepest depths is coarser than the finest errors: the next smaller error then holds.
  for (int error_code = wanted; error_code >= std::max(0, wanted - Impl::kErrorTries); --error_code) {
    Result result = impl_->longest(blocks, error_code, colour_bits, out);
    std::span<const MapBlock> sent = blocks.first(result.blocks);
    if (result.blocks == 0) {
      if (!config.in_parts) return {};
      result = impl_->part(blocks[0], error_code, colour_bits, out);
      if (result.blocks == 0) return {};
      sent = {&impl_->partial, 1};
    }
    if (!impl_->check.decode(out.first(result.bytes)) || !impl_->held(sent, config.max_error)) continue;
    const Header& h = impl_->check.header;
    for (std::size_t k = 0; k < std::min(sent.size(), decoded.size()); ++k)
      takeBlock(impl_->check.content, h, sent[k].key.north - h.north, sent[k].key.east - h.east, decoded[k]);
    return result;
  }
  return {};
}

}  // namespace fathom::telemetry
