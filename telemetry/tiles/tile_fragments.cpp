#include "telemetry/tiles/tile_fragments.hpp"

#include <algorithm>
#include <bit>

#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {
namespace {

constexpr unsigned kLevelBits = 4;
constexpr unsigned kIndexBits = 15;  // signed
constexpr unsigned kFragmentBits = 7;
static_assert(kLevelBits + 2 * kIndexBits + kRevisionBits + kStrideBits + 2 * kFragmentBits ==
              8 * kFragmentHeaderBytes);
constexpr std::int32_t kIndexBound = 1 << (kIndexBits - 1);

std::size_t pieceBytes(std::size_t frame_bytes) {
  return frame_bytes - kFrameOverhead - kFragmentHeaderBytes;
}

}  // namespace

bool makeTileId(const HeightTile& tile, int stride, FragmentTile& id) {
  if (tile.level < 0 || tile.level >= 1 << kLevelBits || tile.north_index < -kIndexBound ||
      tile.north_index >= kIndexBound || tile.east_index < -kIndexBound || tile.east_index >= kIndexBound)
    return false;
  id = {tile.north_index, tile.east_index, tile.level,
        static_cast<std::uint16_t>(tile.revision & ((1U << kRevisionBits) - 1)), stride};
  return true;
}

int fragmentCount(std::size_t tile_bytes, std::size_t frame_bytes) {
  const std::size_t piece = pieceBytes(frame_bytes);
  return static_cast<int>((tile_bytes + piece - 1) / piece);
}

std::size_t encodeFragment(const FragmentTile& id, std::span<const std::uint8_t> tile, int index,
                           std::size_t frame_bytes, std::span<std::uint8_t> out) {
  const std::size_t begin = static_cast<std::size_t>(index) * pieceBytes(frame_bytes);
  const int count = fragmentCount(tile.size(), frame_bytes);
  if (index < 0 || begin >= tile.size() || count > kMaxFragments) return 0;
  const std::size_t length = std::min(pieceBytes(frame_bytes), tile.size() - begin);
  if (out.size() < kFragmentHeaderBytes + length) return 0;
  BitWriter w(out);
  w.put(static_cast<std::uint64_t>(id.level), kLevelBits);
  w.putSigned(id.north_index, kIndexBits);
  w.putSigned(id.east_index, kIndexBits);
  w.put(id.revision, kRevisionBits);
  w.put(static_cast<std::uint64_t>(std::countr_zero(static_cast<unsigned>(id.stride))), kStrideBits);
  w.put(static_cast<std::uint64_t>(index), kFragmentBits);
  w.put(static_cast<std::uint64_t>(count), kFragmentBits);
  const auto piece = tile.subspan(begin, length);
  std::copy(piece.begin(), piece.end(), out.begin() + kFragmentHeaderBytes);
  return kFragmentHeaderBytes + length;
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
