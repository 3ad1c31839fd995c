#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "telemetry/wire/field.hpp"

namespace fathom::telemetry {

// Messages from the ship to the vehicle. None of them reaches vehicle control: acknowledgements and requests
// change only what Fathom sends, a fix only the position estimate in its map.

// The vehicle's frames that the ship has on its disk: the latest, or those of an earlier part of the dive.
// Frames from before the ship was switched on count as not received.
struct Acknowledgement {
  static constexpr std::size_t kMaxReach = 128;

  bool valid = false;             // false: nothing received yet
  std::uint16_t newest = 0;       // sequence number of the newest frame received
  std::size_t reach = 0;          // number of frames before `newest` in `before`, at most kMaxReach
  std::bitset<kMaxReach> before;  // bit i: frame newest - 1 - i was received; i < reach
  std::uint16_t lacking = 0;      // number of frames before those that were not received
  static constexpr std::uint16_t kAll = 0xFFFF;  // of `lacking`: none of the dive's frames before those

  // Whether the frame `back` frames before the newest was received; std::nullopt for a frame that this
  // acknowledgement does not cover.
  [[nodiscard]] std::optional<bool> receivedBack(std::uint32_t back) const {
    if (!valid) return std::nullopt;
    if (back <= reach) return back == 0 || before[back - 1U];
    if (lacking == kAll || back - reach <= lacking) return false;
    return std::nullopt;
  }
  [[nodiscard]] std::optional<bool> received(std::uint16_t sequence) const {
    return receivedBack(static_cast<std::uint16_t>(newest - sequence));
  }
  friend bool operator==(const Acknowledgement&, const Acknowledgement&) = default;
};

// A position of the vehicle, measured from the ship.
struct UsblFixMessage {
  std::int64_t utc_ns = 0;             // of the measurement, sent to 10 ms
  double latitude = 0, longitude = 0;  // WGS84 [deg], sent to 1e-7 deg (1.1 cm)
  double depth = 0;                    // below the surface [m], or NaN
  double sigma = 0;                    // standard deviation, horizontal, one axis [m], or NaN
};

// A request for a change of what the vehicle sends.
struct Request {
  enum class Kind : std::uint8_t {
    kDetail = 0,      // this rectangle at this spacing
    kRate = 1,        // send at so many bit/s from now on
    kPauseMap = 2,    // send no map until kResumeMap; status and track continue
    kResumeMap = 3,   // what waited is sent
    kSendStatus = 4,  // a status message now
  };
  Kind kind = Kind::kSendStatus;
  std::uint8_t id = 0;  // 0 to 15; a repetition of the same request has the same
  // kDetail: in nav [m]
  double north_min = 0, north_max = 0, east_min = 0, east_max = 0;
  double spacing = 0.25;    // between nodes [m]: a power of two, 1/64 m to 1 m
  double max_error = 0.05;  // of the heights [m]
  // kRate
  double rate_bps = 0;  // [bit/s]
  friend bool operator==(const Request&, const Request&) = default;
};
inline constexpr std::size_t kRequestKinds = 5;
[[nodiscard]] const char* name(Request::Kind kind);

namespace schema {
// Values out of bounds are not sent.
inline constexpr Field kFixAge{0, 163.83, 0.01};        // before the time in the downlink's counter [s]
inline constexpr Field kFixLatitude{-90, 90, 1e-7};     // [deg]
inline constexpr Field kFixLongitude{-180, 180, 1e-7};  // [deg]
inline constexpr Field kFixDepth{0, 6500, 0.5, true};   // [m]
inline constexpr Field kFixSigma{0, 51.0, 0.1, true};   // [m]
inline constexpr Field kRequestKind{0, 7, 1};
inline constexpr Field kRequestId{0, 15, 1};
inline constexpr Field kDetailCorner{-52428.7, 52428.7, 0.1};  // north or east [m]
inline constexpr Field kDetailSide{0.1, 819.2, 0.1};           // of the rectangle [m]
inline constexpr Field kDetailSpacing{-6, 0, 1};               // log2 of metres
inline constexpr Field kDetailError{0.01, 0.32, 0.01};         // [m]
inline constexpr Field kRequestRate{80, 10310, 10};            // [bit/s]
}  // namespace schema

// Whether every value is inside its bounds: a rectangle with sides of 0.1 to 819 m, a spacing that is a power
// of two.
[[nodiscard]] bool validate(const Request& request);
[[nodiscard]] bool validate(const UsblFixMessage& fix);

// Content of one downlink frame: at least one of the three.
struct DownlinkContent {
  std::optional<UsblFixMessage> fix;
  std::optional<Request> request;
  std::optional<Acknowledgement> acknowledgement;
  [[nodiscard]] bool empty() const { return !fix && !request && !acknowledgement; }
};

// The counter of a downlink frame is its time in tenths of seconds since 2025-01-01 UTC (13 years), and
// greater than that of the frame before. Being a time, it needs no storage over a restart of either end.
using DownlinkCounter = std::uint32_t;
[[nodiscard]] DownlinkCounter downlinkCounterAt(std::int64_t utc_ns);  // rounded up; saturates
[[nodiscard]] std::int64_t downlinkTime(DownlinkCounter counter);      // UTC [ns]

// Writes the content without its signature. Returns the bytes written, 0 if `out` is too small or a value
// cannot be sent (a fix after `counter` or too old, a request out of bounds). An acknowledgement takes the
// rest of `out`, at most its own reach (less up to seven frames, to end with a byte), and is left out when
// `newest` does not fit. The first bit is set when a signature follows, which the caller appends.
[[nodiscard]] std::size_t encodeDownlink(const DownlinkContent& content, DownlinkCounter counter,
                                         bool is_signed, std::span<std::uint8_t> out);

struct DecodedDownlink {
  bool is_signed = false;
  DownlinkCounter counter = 0;
  DownlinkContent content;
};
// Decodes what encodeDownlink wrote (without the signature); false for anything else.
[[nodiscard]] bool decodeDownlink(std::span<const std::uint8_t> bytes, DecodedDownlink& out);

}  // namespace fathom::telemetry
