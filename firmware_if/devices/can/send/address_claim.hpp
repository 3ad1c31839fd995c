#pragma once

#include <bitset>
#include <cstdint>
#include <span>

#include "firmware_if/devices/can/can_frame.hpp"

namespace fathom::io {

inline constexpr std::uint32_t kAddressClaimPgn = 60928;
inline constexpr std::uint32_t kRequestPgn = 59904;
inline constexpr std::uint8_t kEveryone = 255;
inline constexpr std::uint8_t kNoAddress = 254;  // source of a device that could not claim one

// Unique identity of a device on the bus (SAE J1939-81, NMEA 2000 appendix D); the lower of two wins an
// address.
struct N2kDeviceName {
  std::uint32_t unique_number = 0;      // 21 bits
  std::uint16_t manufacturer_code = 0;  // 11 bits, given out by NMEA
  std::uint8_t device_instance = 0;
  std::uint8_t function = 0;
  std::uint8_t device_class = 0;  // 7 bits

  // As the wire has it: marine industry, arbitrary address capable.
  [[nodiscard]] std::uint64_t packed() const noexcept;
};

// How a device gets its address and keeps it (SAE J1939-81, section 4): it claims one, and has it when nobody
// objected for 250 ms. It answers requests for claims, and claims of its address by others: the lower NAME
// keeps the address; the other device claims one that it has received no frame from and, when there is none,
// says so and is silent. Sans I/O.
class AddressClaim {
 public:
  AddressClaim(std::uint64_t name, std::uint8_t preferred) noexcept
      : name_(name), preferred_(preferred), address_(preferred) {}

  // The bus is there, or there again: claims an address.
  void start() noexcept;
  // To be called with every frame received; `payload` is read of 60928 and 59904.
  void receive(const N2kId& id, std::span<const std::uint8_t> payload, std::int64_t now_ns) noexcept;
  // Whether a claim is due now, and the claim (source kNoAddress when none could be had).
  [[nodiscard]] bool claimDue(std::int64_t now_ns) const noexcept { return due_ && now_ns >= due_ns_; }
  [[nodiscard]] CanFrame claim() const noexcept;
  void claimSent(std::int64_t now_ns) noexcept;

  // True when the address may be used.
  [[nodiscard]] bool held(std::int64_t now_ns) noexcept;
  [[nodiscard]] std::uint8_t address() const noexcept { return address_; }
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }  // addresses lost to others

 private:
  static constexpr std::uint8_t kLastAddress = 251;  // for devices; 252 and 253 are reserved
  void lose(std::int64_t now_ns) noexcept;

  std::uint64_t name_;
  std::uint8_t preferred_, address_;
  std::bitset<256> taken_;  // addresses that frames were received from
  bool due_ = false, claimed_ = false, held_ = false;
  std::int64_t due_ns_ = 0, claimed_ns_ = 0;
  std::uint64_t lost_ = 0;
};

}  // namespace fathom::io
