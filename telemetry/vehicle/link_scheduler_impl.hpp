#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/repair/repair.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "telemetry/vehicle/sent_frames.hpp"
#include "telemetry/vehicle/turn_taking.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// State of a LinkScheduler: it sends in link_scheduler.cpp, takes the ship's messages in
// link_scheduler_downlink.cpp and is saved in link_scheduler_state.cpp.
struct LinkScheduler::Impl {
  explicit Impl(const LinkSchedulerConfig& c);
  void setRate(double rate_bps);
  void applyRate();
  // Writes the link frame of the payload from choose(), `payload_bytes` long; true: it gives the turn.
  bool addFrame(std::size_t payload_bytes, std::int64_t begin_ns, ModemFrameWriter& modem);
  [[nodiscard]] std::size_t choose();
  // A map packet, filled with unacknowledged blocks that were sent fewer than `sendings` times and not within
  // `after_s`.
  [[nodiscard]] std::size_t mapPacket(int sendings, double after_s);
  [[nodiscard]] std::size_t carousel();
  [[nodiscard]] std::size_t repairFrame();
  [[nodiscard]] std::size_t probe();
  void closeDetails();
  [[nodiscard]] bool turnAfter(std::int64_t left_ns);
  // Skips this many versions.
  void passOver(Version numbers);
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  // Whether repair frames are sent: no acknowledgements come.
  [[nodiscard]] bool blind() const { return config.repair && !turns.answered(); }
  [[nodiscard]] std::size_t payloadRoom() const { return frame_room - kFrameOverhead; }

  // Whether the frame has only the rest of a bundle.
  [[nodiscard]] bool isRest() const { return frame_room < static_cast<std::size_t>(config.frame_bytes); }
  static constexpr std::size_t kMaxDetails = 4;  // at once, those being sent included

  LinkSchedulerConfig config;
  TokenBucket bucket;
  BlockQueue queue;
  SentFrames sent;
  RepairEncoder repair;
  Housekeeping housekeeping;
  TurnTaking turns;
  LastingRequests lasting;
  MapPacketEncoder encoder;
  Counters counters;
  std::int64_t now = 0, busy_until = 0;
  int frames_since_turn = 0;
  std::array<Detail, kMaxDetails> details{};  // the first detail_count are not offered yet
  std::size_t detail_count = 0, detail_known = 0;

  // The frame being written.
  std::size_t frame_room = kMinFrameBytes;  // for it, its overhead included [B]
  MessageType type = MessageType::kStatus;
  Version frame_version = 0;
  std::uint8_t frame_group = 0;  // see DecodedFrame
  std::size_t batch_sent = 0;    // blocks in it
  bool again = false;            // part of the carousel, which repeats everything and needs no repair
  BlockQueue::Batch batch;
  std::array<MapBlock, BlockQueue::kMaxBatch> decoded;
  std::array<std::uint8_t, kMaxFrameBytes> payload{};
};

}  // namespace fathom::telemetry
