#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::telemetry {

// The ship's end of the downlink: keeps what is to be sent to the vehicle and writes it into one frame at the
// ship's turn. Bounded; no clocks.
class DownlinkSender {
 public:
  static constexpr std::size_t kMaxRequests = 16;  // waiting; more are refused
  static constexpr int kRepetitions = 8;           // of a request until it is confirmed

  // Without a key nothing is signed, and a vehicle that has a key ignores the frames. `frame_bytes`: of the
  // downlink's frames, 32 to 256.
  DownlinkSender(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                 std::size_t frame_bytes = kMinFrameBytes);

  // Replaces the acknowledgement to send; it is sent at every turn, or every second one when other content
  // fills the frame.
  void acknowledge(const Acknowledgement& acknowledgement);
  // Replaces the fix to send, which is sent once. False for a fix out of bounds.
  bool addFix(const UsblFixMessage& fix);
  // Queues a request, in place of an earlier one that it makes void (another rate, pause and resume). Returns
  // the id given to it; std::nullopt when it is out of bounds or too many wait.
  std::optional<std::uint8_t> request(Request request);
  // The vehicle has confirmed the request: it is not sent again.
  void confirm(std::uint8_t request_id);

  // Writes the frame to send now; 0 when there is nothing to send.
  [[nodiscard]] std::size_t nextFrame(std::int64_t utc_ns, std::span<std::uint8_t> out);

  // Whether a request is still to be sent, for the first time or again.
  [[nodiscard]] bool waits(std::uint8_t request_id) const;
  struct Counters {
    std::uint64_t frames = 0, acknowledgements = 0, fixes = 0, requests = 0;  // sent, repetitions included
    std::uint64_t stale_fixes = 0;                                            // too old or too new to be sent
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  struct Waiting {
    Request request;
    int said = 0;
  };
  [[nodiscard]] std::size_t payloadRoom() const;
  [[nodiscard]] bool fits(const DownlinkContent& content, std::size_t acknowledgement_bits) const;
  [[nodiscard]] DownlinkContent chooseContent() const;
  void noteSaid(const DownlinkContent& content);

  LinkIdentity identity_;
  std::optional<LinkKey> key_;
  std::size_t frame_bytes_;
  std::optional<Acknowledgement> acknowledgement_;
  bool acknowledgement_due_ = false;  // the frame before had none
  std::optional<UsblFixMessage> fix_;
  std::deque<Waiting> requests_;  // the front is sent next; new ones before those to repeat
  std::uint8_t next_id_ = 0;
  DownlinkCounter counter_ = 0;  // of the newest frame
  std::uint16_t sequence_ = 0;
  Counters counters_;
};

enum class DownlinkVerdict : std::uint8_t {
  kAccepted,
  kBadFrame,    // not a whole downlink frame of this protocol
  kForeign,     // for another vehicle or dive
  kBadPayload,  // whole, but no message
  kUnsigned,    // this vehicle has a key and the frame no signature
  kOld,  // neither its counter nor its acknowledgement is newer than the last: replayed, overtaken, doubled
  kBadSignature,
  kStale,  // its time is far from the vehicle's and it acknowledges no recent frame: delayed
  kNoKey,  // a request, and this vehicle has no key to verify it
};
inline constexpr std::size_t kDownlinkVerdicts = 9;
[[nodiscard]] const char* name(DownlinkVerdict verdict);

// The vehicle's end of the downlink: admits the ship's frames to this vehicle on this dive, each once, and
// counts the rest. With a key it admits only recent frames with a valid signature; without one,
// acknowledgements and fixes but no requests. A frame is recent when its time is within kFresh_s of the
// vehicle's, or when it acknowledges a frame sent within kFresh_s: so a wrong clock at either end does not
// cut the link. Every signature is checked (a microsecond or two), so that a flood of forged frames delays no
// valid one. No heap, no clocks.
class DownlinkReceiver {
 public:
  // With a key, frames from before `not_before_utc_ns` are not admitted: recordings from before the dive.
  DownlinkReceiver(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                   std::int64_t not_before_utc_ns);

  struct Result {
    DownlinkVerdict verdict = DownlinkVerdict::kBadFrame;
    // What to act on. Of a repeated request for detail the frame is admitted without the request (repeating
    // the others has no effect); with kNoKey the request is left out, while fix and acknowledgement are kept.
    DownlinkContent content;
    DownlinkCounter counter = 0;  // of the frame
  };
  // The frame that an acknowledgement names, if the vehicle sent it within the last kFresh_s.
  using SentLately = std::function<std::optional<Version>(const Acknowledgement&)>;
  static constexpr double kFresh_s = 600;
  Result accept(std::int64_t now_ns, std::span<const std::uint8_t> frame, const SentLately& sent_lately = {});

  struct Counters {
    std::array<std::uint64_t, kDownlinkVerdicts> verdicts{};  // by DownlinkVerdict
    std::uint64_t acknowledgements = 0, fixes = 0, requests = 0, repeated_requests = 0;
    [[nodiscard]] std::uint64_t operator[](DownlinkVerdict v) const {
      return verdicts[static_cast<std::size_t>(v)];
    }
    // Frames that are not whole, not from the ship or not for this vehicle.
    [[nodiscard]] std::uint64_t refused() const;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // Saves and loads all but the key, bit by bit, for the same dive: frames admitted before stay old.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  Result judge(std::int64_t now_ns, std::span<const std::uint8_t> frame, const SentLately& sent_lately);
  [[nodiscard]] bool isRepetition(std::int64_t now_ns, const Request& request);

  LinkIdentity identity_;
  std::optional<LinkKey> key_;
  DownlinkCounter counter_;  // of the newest frame admitted
  bool accepted_any_ = false;
  Version acknowledged_ = 0;  // newest of the vehicle's frames that an admitted one acknowledged
  struct RecentDetail {
    std::int64_t utc_ns = 0;
    Request request;
  };
  std::array<std::optional<RecentDetail>, 16> details_;  // the last ones asked for, a ring
  std::size_t next_detail_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
