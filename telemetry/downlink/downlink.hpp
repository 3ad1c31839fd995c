#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/link_key.hpp"

namespace fathom::telemetry {

// The ship's voice: keeps what the vehicle should be told and puts it into one frame when it is the ship's
// turn. Bounded; no clocks.
class DownlinkSender {
 public:
  static constexpr std::size_t kMaxRequests = 16;  // waiting; more are refused
  static constexpr int kRepetitions = 8;           // a request is said so often unless it was confirmed

  // Without a key nothing is signed, and a vehicle that has one ignores it all. `frame_bytes`: of the
  // downlink's frames, 32 to 256.
  DownlinkSender(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                 std::size_t frame_bytes = kMinFrameBytes);

  // The newest counts; is said at every turn, or every second one where other things fill the frame.
  void acknowledge(const Acknowledgement& acknowledgement);
  // The newest counts; said once. False for a fix out of bounds.
  bool addFix(const UsblFixMessage& fix);
  // Takes the place of an earlier request that it makes void (another rate, pause and resume). Returns the id
  // given to it; std::nullopt when it is out of bounds or too many wait.
  std::optional<std::uint8_t> request(Request request);
  // The vehicle has done it: it is not said again.
  void confirm(std::uint8_t request_id);

  // The frame to send now, or 0 when there is nothing to say.
  [[nodiscard]] std::size_t nextFrame(std::int64_t utc_ns, std::span<std::uint8_t> out);

  [[nodiscard]] std::size_t requestsWaiting() const { return requests_.size(); }
  // Whether a request is to be said, for the first time or again.
  [[nodiscard]] bool waits(std::uint8_t request_id) const;
  struct Counters {
    std::uint64_t frames = 0, acknowledgements = 0, fixes = 0, requests = 0;  // said, repetitions included
    std::uint64_t stale_fixes = 0;                                            // too old or too new to be said
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
  bool acknowledgement_due_ = false;  // the frame before said none
  std::optional<UsblFixMessage> fix_;
  std::deque<Waiting> requests_;  // the front is said next; new ones before those to repeat
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
  kOld,  // neither its counter nor what it has heard is newer than the last: replayed, overtaken, doubled
  kBadSignature,
  kStale,  // said long ago, or by a clock that is off, and it has heard nothing lately: held back on the way
  kNoKey,  // a request, and this vehicle has no key to trust it by
};
inline constexpr std::size_t kDownlinkVerdicts = 9;
[[nodiscard]] const char* name(DownlinkVerdict verdict);

// The vehicle's ear: admits what the ship says to this vehicle on this dive, once each, and keeps the account
// of the rest. With a key, only what carries the right signature and was said lately; without one,
// acknowledgements and fixes but no requests. A frame was said lately when its time is near the vehicle's, or
// when it acknowledges what the vehicle sent a short while ago: so a clock that is off, on either side, mutes
// nobody. Every signature is checked (a microsecond or two): a flood of false ones hides no true one. No
// heap, no clocks.
class DownlinkReceiver {
 public:
  // Frames older than `not_before_utc_ns` (with a key) are not admitted: recordings from before the dive.
  DownlinkReceiver(const LinkIdentity& identity, const std::optional<LinkKey>& key,
                   std::int64_t not_before_utc_ns);

  struct Result {
    DownlinkVerdict verdict = DownlinkVerdict::kBadFrame;
    // What to act on. A repetition of a request for detail is admitted, but its request left out (the others
    // do nothing when they are said again); so is a request where the verdict is kNoKey, while fix and
    // acknowledgement of that frame stand.
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
    // Frames that were not for us, not from the ship or not whole.
    [[nodiscard]] std::uint64_t refused() const;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // Bit by bit, but for the key, into one of the same dive: what was admitted stays old.
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
  bool heard_ = false;
  Version acknowledged_ = 0;  // the newest frame that one admitted has heard
  struct Heard {
    std::int64_t utc_ns = 0;
    Request request;
  };
  std::array<std::optional<Heard>, 16> details_;  // the last ones asked for, a ring
  std::size_t next_detail_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
