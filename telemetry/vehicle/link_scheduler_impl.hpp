#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "telemetry/map/map_packet.hpp"
#include "telemetry/repair/repair_encoder.hpp"
#include "telemetry/vehicle/link_scheduler.hpp"
#include "telemetry/vehicle/sent_frames.hpp"
#include "telemetry/vehicle/token_bucket.hpp"
#include "telemetry/vehicle/turn_taking.hpp"
#include "telemetry/vehicle/wishes.hpp"
#include "telemetry/wire/bundle.hpp"

namespace fathom::telemetry {

// State of a LinkScheduler: what it does is in link_scheduler.cpp, how it is saved in link_state.cpp.
struct LinkScheduler::Impl {
  explicit Impl(const LinkSchedulerConfig& c);
  void setRate(double rate_bps);
  void applyRate();
  // Writes the link frame that choose() gave `payload_bytes` of; true: it gives the turn.
  bool addFrame(std::size_t payload_bytes, std::int64_t begin_ns, ModemFrameWriter& modem);
  [[nodiscard]] std::size_t choose();
  // With room for blocks without word that were sent less often than that, and not within `after_s`.
  [[nodiscard]] std::size_t mapPacket(int sendings, double after_s);
  [[nodiscard]] std::size_t carousel();
  [[nodiscard]] std::size_t repairFrame();
  [[nodiscard]] std::size_t probe();
  void closeDetails();
  [[nodiscard]] bool turnAfter(std::int64_t left_ns);
  // So many versions are not used.
  void passOver(Version numbers);
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  // Repair frames are of use where acknowledgements are not.
  [[nodiscard]] bool blind() const { return config.repair && !turns.answered(); }
  [[nodiscard]] std::size_t payloadRoom() const { return frame_room - kFrameOverhead; }

  // Only the rest of a bundle is left for the frame.
  [[nodiscard]] bool isRest() const { return frame_room < static_cast<std::size_t>(config.frame_bytes); }
  static constexpr std::size_t kMaxDetails = 4;  // at once, on their way included

  LinkSchedulerConfig config;
  TokenBucket bucket;
  BlockQueue queue;
  SentFrames sent;
  RepairEncoder repair;
  Housekeeping housekeeping;
  TurnTaking turns;
  Wishes wishes;
  MapPacketEncoder encoder;
  Counters counters;
  std::int64_t now = 0, busy_until = 0;
  int frames_since_turn = 0;
  std::array<Detail, kMaxDetails> details{};  // the first detail_count are not offered yet
  std::size_t detail_count = 0, detail_known = 0;

  // The frame being made.
  std::size_t frame_room = kMinFrameBytes;  // for it, its overhead included [B]
  MessageType type = MessageType::kStatus;
  Version frame_version = 0;
  std::uint8_t frame_group = 0;  // see DecodedFrame
  std::size_t batch_sent = 0;    // blocks in it
  bool again = false;            // of the carousel: it comes again by itself, and needs no repair
  BlockQueue::Batch batch;
  std::array<MapBlock, BlockQueue::kMaxBatch> decoded;
  std::array<std::uint8_t, kMaxFrameBytes> payload{};
};

}  // namespace fathom::telemetry
