#include "firmware_if/devices/can/send/address_claim.hpp"

#include "firmware_if/devices/can/send/n2k_encoder.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kObjection_ns = 250 * kMillisecond_ns;
// A device that could not claim an address says so after 0 to 153 ms, lest all such send at once.
constexpr std::int64_t kDelayStep_ns = kMillisecond_ns * 6 / 10;
constexpr std::uint8_t kClaimPriority = 6;

}  // namespace

std::uint64_t N2kDeviceName::packed() const noexcept {
  constexpr std::uint64_t kMarine = 4, kArbitraryAddressCapable = 1;
  return (unique_number & 0x1FFFFFU) | std::uint64_t{manufacturer_code & 0x7FFU} << 21 |
         std::uint64_t{device_instance} << 32 | std::uint64_t{function} << 40 |
         std::uint64_t{device_class & 0x7FU} << 49 | kMarine << 60 | kArbitraryAddressCapable << 63;
}

void AddressClaim::start() noexcept {
  taken_.reset();
  if (address_ == kNoAddress) address_ = preferred_;
  due_ = true;
  due_ns_ = 0;
  claimed_ = held_ = false;
}

void AddressClaim::receive(const N2kId& id, std::span<const std::uint8_t> payload,
                           std::int64_t now_ns) noexcept {
  if (id.pgn == kRequestPgn) {
    const bool for_us = id.destination == kEveryone || (id.destination == address_ && address_ != kNoAddress);
    if (for_us && payload.size() >= 3 && readLittleEndian(payload.first(3)) == kAddressClaimPgn && !due_) {
      due_ = true;
      due_ns_ =
          address_ == kNoAddress ? now_ns + static_cast<std::int64_t>(name_ & 0xFF) * kDelayStep_ns : now_ns;
    }
    return;
  }
  if (id.source <= kLastAddress) taken_.set(id.source);
  if (id.pgn != kAddressClaimPgn || payload.size() != 8 || id.source != address_ || address_ == kNoAddress)
    return;
  if (name_ < readLittleEndian(payload)) {
    due_ = true;
    due_ns_ = now_ns;
  } else {
    lose(now_ns);
  }
}

void AddressClaim::lose(std::int64_t now_ns) noexcept {
  ++lost_;
  due_ = true;
  due_ns_ = now_ns;
  claimed_ = held_ = false;
  for (unsigned step = 1; step <= kLastAddress; ++step) {
    const auto next = static_cast<std::uint8_t>((address_ + step) % (kLastAddress + 1U));
    if (taken_.test(next)) continue;
    address_ = next;
    return;
  }
  address_ = kNoAddress;
  due_ns_ += static_cast<std::int64_t>(name_ & 0xFF) * kDelayStep_ns;
}

CanFrame AddressClaim::claim() const noexcept {
  CanFrame out;
  out.id = makeN2kId({kClaimPriority, kAddressClaimPgn, address_, kEveryone});
  out.size = 8;
  writeLittleEndian(out.data, name_);
  return out;
}

void AddressClaim::claimSent(std::int64_t now_ns) noexcept {
  due_ = false;
  // An answer to a request, or to a claim that lost, does not restart the wait.
  if (claimed_ || address_ == kNoAddress) return;
  claimed_ = true;
  claimed_ns_ = now_ns;
}

bool AddressClaim::held(std::int64_t now_ns) noexcept {
  if (claimed_ && now_ns - claimed_ns_ >= kObjection_ns) held_ = true;
  return held_;
}

}  // namespace fathom::io
