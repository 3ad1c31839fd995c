#include "firmware_if/devices/can/fast_packet.hpp"

#include <algorithm>
#include <cstring>

namespace fathom::io {
namespace {

constexpr std::size_t kBytesInFirst = 6;
constexpr std::size_t kBytesInOthers = 7;

}  // namespace

FastPacketAssembler::FastPacketAssembler(const Config& config)
    : config_(config), slots_(std::max(config.slots, std::size_t{1})) {}

FastPacketAssembler::Slot* FastPacketAssembler::find(const N2kId& id, std::uint8_t sequence) noexcept {
  const auto found = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& slot) {
    return slot.busy && slot.pgn == id.pgn && slot.source == id.source &&
           slot.destination == id.destination && slot.sequence == sequence;
  });
  return found == slots_.end() ? nullptr : &*found;
}

FastPacketAssembler::Slot& FastPacketAssembler::freeSlot() noexcept {
  Slot* oldest = &slots_.front();
  for (Slot& slot : slots_) {
    if (!slot.busy) return slot;
    if (slot.updated < oldest->updated) oldest = &slot;
  }
  giveUp(*oldest);
  return *oldest;
}

void FastPacketAssembler::giveUp(Slot& slot) noexcept {
  slot.busy = false;
  ++counts_.incomplete;
}

std::span<const std::uint8_t> FastPacketAssembler::add(const N2kId& id, const CanFrame& frame) noexcept {
  ++frames_;
  const std::span<const std::uint8_t> data = frame.bytes();
  if (data.size() < 2) {
    ++counts_.broken;
    return {};
  }
  const auto sequence = static_cast<std::uint8_t>(data[0] >> 5);
  const std::size_t index = data[0] & 0x1F;

  Slot* slot = find(id, sequence);
  if (slot != nullptr && slot->utc_ns && frame.utc_ns) {
    const std::int64_t waited = *frame.utc_ns - *slot->utc_ns;
    if (waited > config_.timeout_ns || waited < -config_.timeout_ns) {
      giveUp(*slot);
      slot = nullptr;
    }
  }

  std::size_t begin = 0;
  std::span<const std::uint8_t> payload;
  if (index == 0) {
    if (slot != nullptr) giveUp(*slot);
    const std::size_t length = data[1];
    if (length == 0 || length > kMaxBytes) {
      ++counts_.broken;
      return {};
    }
    slot = &freeSlot();
    slot->busy = true;
    slot->pgn = id.pgn;
    slot->source = id.source;
    slot->destination = id.destination;
    slot->sequence = sequence;
    slot->length = static_cast<std::uint8_t>(length);
    const std::size_t behind_first = length - std::min(length, kBytesInFirst);
    const std::size_t frames = 1 + (behind_first + kBytesInOthers - 1) / kBytesInOthers;
    slot->missing = static_cast<std::uint32_t>((std::uint64_t{1} << frames) - 1);
    payload = data.subspan(2);
  } else {
    if (slot == nullptr) {
      ++counts_.orphans;
      return {};
    }
    begin = kBytesInFirst + (index - 1) * kBytesInOthers;
    payload = data.subspan(1);
  }

  const std::uint32_t bit = std::uint32_t{1} << index;
  if ((slot->missing & bit) == 0) {
    // The same index again, or one behind the end: the frame 0 of these frames was lost.
    giveUp(*slot);
    ++counts_.orphans;
    return {};
  }
  const std::size_t wanted =
      std::min<std::size_t>(slot->length - begin, index == 0 ? kBytesInFirst : kBytesInOthers);
  if (payload.size() < wanted) {
    giveUp(*slot);
    ++counts_.broken;
    return {};
  }
  std::memcpy(slot->bytes.data() + begin, payload.data(), wanted);
  slot->missing &= ~bit;
  slot->updated = frames_;
  slot->utc_ns = frame.utc_ns;
  if (slot->missing != 0) return {};
  slot->busy = false;
  ++counts_.complete;
  return {slot->bytes.data(), slot->length};
}

void FastPacketAssembler::finish() noexcept {
  for (Slot& slot : slots_) {
    if (slot.busy) giveUp(slot);
  }
}

}  // namespace fathom::io
