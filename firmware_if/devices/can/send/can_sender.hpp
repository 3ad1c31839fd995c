#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "firmware_if/devices/can/can_frame.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"

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

// What Fathom sends to other equipment on the bus. Trivially copyable, so that it crosses threads in a
// latest-value slot.
struct VehicleReport {
  std::int64_t utc_ns = 0;                 // at which it was true
  std::optional<double> latitude;          // of the vehicle, estimated [rad]
  std::optional<double> longitude;         // [rad]
  std::optional<double> sigma_horizontal;  // of either horizontal component [m]
  std::optional<double> depth;             // of the vehicle below the surface [m]
  std::optional<double> altitude;          // above the seafloor [m]
  double map_area = 0;                     // seafloor mapped [m2]
  std::uint32_t pairs_mapped = 0;          // stereo pairs in the map
  std::uint32_t pairs_dropped = 0;         // stereo pairs that gave the map nothing
  std::uint16_t health = 0;  // flags as in the modem's status (telemetry/wire/uplink_messages.hpp)
  std::optional<double> mission_progress;  // 0 to 1
};

// Sends the vehicle's position and the state of the map to other equipment. Fathom never sends anything that
// commands or asks: kSentPgns is all that ever leaves. Sans I/O: received frames and reports in, frames to
// send out. Allocates nothing.
//
//   60928   address claim (AddressClaim)                               when due
//   59392   "not available" to a request for anything else             when asked
//   126464  the lists of groups sent and received                      when asked
//   126993  heartbeat                                                  every 60 s
//   126996  product information                                        when asked
//   128267  water depth: depth below the transducer = altitude, offset = depth of the vehicle (within 32 m)
//   129025  position, rapid update
//   129029  position, marked as estimated (dead reckoning), no satellites
//   130816 to 131071, one of them: map status, a fast packet of 20 bytes, little endian:
//     0  u16  bits 0-10 manufacturer code, 11-12 ones, 13-15 industry 4 (marine)
//     2  u8   version of this layout, 1
//     3  u8   mission progress, 0.5 %; 255 unknown
//     4  u32  seafloor mapped [m2]
//     8  u32  stereo pairs in the map
//    12  u32  stereo pairs that gave the map nothing
//    16  u16  health flags (telemetry/wire/uplink_messages.hpp)
//    18  u16  standard deviation of the position, horizontal, one axis [cm]; 65533 and above unknown
//
// A report older than kReportHolds_s is not sent on. No more than `frames_per_s` leave; what waits longer
// than kFrameHolds_s (bus-off, a full bus) is dropped, and a fast packet that does not fit the queue is
// dropped whole.
class CanSender {
 public:
  static constexpr std::array<std::uint32_t, 8> kSentPgns = {59392,  60928,  126464, 126993,
                                                             126996, 128267, 129025, 129029};
  static constexpr std::uint32_t kFirstStatusPgn = 130816, kLastStatusPgn = 131071;
  static constexpr std::int64_t kReportHolds_s = 3;
  static constexpr std::int64_t kFrameHolds_s = 1;

  struct Config {
    std::uint8_t address = 120;  // preferred
    // Manufacturer code 2046 is not assigned; on a public bus one of NMEA's is needed.
    // Class 60, navigation; function 175, integrated navigation.
    N2kDeviceName name = {1, 2046, 0, 175, 60};
    // Between two of a kind [s]; 0: never.
    double position_period_s = 1, fix_period_s = 5, depth_period_s = 1, status_period_s = 5;
    std::uint32_t status_pgn = 130900;
    double frames_per_s = 100;  // about 5 % of the bus
    std::string software_version;

    // Throws std::invalid_argument.
    void validate() const;
  };
  struct Counts {
    std::uint64_t queued = 0, dropped = 0;  // frames
    std::uint64_t requests = 0;             // of others, answered
  };

  explicit CanSender(const Config& config);

  // The bus is there, or there again.
  void start() noexcept;
  // To be called with every data frame received.
  void receive(const CanFrame& frame, std::int64_t now_ns) noexcept;
  void publish(const VehicleReport& report) noexcept;

  // The frame to send now, or nullptr; sent() is to be called when it went. `now_ns`: vehicle time.
  [[nodiscard]] const CanFrame* next(std::int64_t now_ns) noexcept;
  void sent(std::int64_t now_ns) noexcept;

  [[nodiscard]] const AddressClaim& claim() const noexcept { return claim_; }
  [[nodiscard]] const Counts& counts() const noexcept { return counts_; }

 private:
  struct Waiting {
    CanFrame frame;
    std::int64_t since_ns = 0;
  };
  struct Period {
    std::int64_t every_ns = 0;  // 0: never
    std::int64_t next_ns = 0;
  };
  [[nodiscard]] static bool due(Period& period, std::int64_t now_ns) noexcept;
  void send(std::uint8_t priority, std::uint32_t pgn, std::uint8_t destination,
            std::span<const std::uint8_t> payload, std::int64_t now_ns) noexcept;
  void answer(const N2kId& id, std::uint32_t pgn, std::int64_t now_ns) noexcept;
  void sendReports(std::int64_t now_ns) noexcept;
  void sendFix(std::int64_t now_ns) noexcept;
  void sendStatus(std::int64_t now_ns) noexcept;
  void sendProduct(std::uint8_t destination, std::int64_t now_ns) noexcept;
  void sendLists(std::uint8_t destination, std::int64_t now_ns) noexcept;

  Config config_;
  AddressClaim claim_;
  VehicleReport report_;
  Period position_, fix_, depth_, status_, heartbeat_;
  rt::FixedQueue<Waiting, 128> queue_;
  CanFrame out_;
  bool out_is_claim_ = false;
  double tokens_ = 0;  // frames that may leave now
  std::int64_t tokens_ns_ = 0;
  std::uint8_t sid_ = 0;  // of the report: messages that bear one are of one instant
  std::uint8_t heartbeats_ = 0;
  std::uint8_t sequence_ = 0;  // of fast packets
  Counts counts_;
};

}  // namespace fathom::io
