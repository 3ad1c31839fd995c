#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/geometry/height_tile.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/vehicle/housekeeping.hpp"
#include "telemetry/vehicle/sent_frames.hpp"
#include "telemetry/wire/downlink_messages.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace fathom::telemetry {

struct LinkSchedulerConfig {
  LinkIdentity identity;
  FrameTag tag;                        // that authenticates the frames
  Version first = SentFrames::kFirst;  // frame; see firstVersion()
  double rate_bps = 300;  // of the modem; 80 to 5400 on acoustic ones; 10 to 1e6 accepted [bit/s]
  int frame_bytes = 128;  // largest link frame, 32 to 256 [B]
  // Largest modem frame, 64 to 2048 and frame_bytes + 2 at least [B]: link frames go in bundles of so many
  // bytes at most (frame.hpp); 0: each by itself.
  int modem_bytes = 0;
  bool padded = false;          // always a bundle, filled with zeros to modem_bytes
  double preamble_s = 0;        // that each modem frame takes beside its bits, 0 to 5 [s]
  double duty = 1;              // share of the time that the modem may send, 0.05 to 1
  double loss_rate = 0.1;       // share of frames expected to be lost, until measured, 0 to 0.9
  double mean_burst = 0;        // frames lost in a row, expected until measured; 0: each by itself
  bool repair = true;           // Reed-Solomon frames while no acknowledgements come
  bool half_duplex = true;      // takes turns with the ship; false: never listens
  double listen_every_s = 0;    // between turns; 0: by rule, so that listening takes a fifth of the time
  int listen_every_frames = 0;  // or after so many frames; 0: at most half of what one can acknowledge
  double listen_s = 0;          // 0: by rule, 2 max_delay_s and the ship's modem frame
  double max_delay_s = 1;       // in one direction, of sound and modems [s]
  HousekeepingConfig housekeeping;
  int colour_bits = 3;  // of a map packet's brightness, 0 (no colour) to 6
  BlockQueueConfig blocks;

  void validate() const;  // throws std::invalid_argument naming the value
};

// Decides what the vehicle sends next over the acoustic link. Sans-I/O and deterministic: the caller gives
// the time, sends the frames and passes on the ship's messages. Priorities:
//   1 status, mission info and track when due (within their share of the rate);
//   2 repair frames, while no acknowledgements come;
//   3 map packets in BlockQueue's order.
// The modem never holds more than it can send within a second or a modem frame. Over any window of W seconds
// at most rate * duty * W / 8 + two modem frames (or a second's worth) leave; a preamble counts as the bits
// that its time would carry. While acknowledgements come, each lost block is sent again with its present
// content until it has arrived. Otherwise each group of frames is followed by as many repair frames as the
// loss requires.
//
// Everything is bounded and counted; nextFrame() does not call the heap.
class LinkScheduler {
 public:
  explicit LinkScheduler(const LinkSchedulerConfig& config);
  ~LinkScheduler();

  // The vehicle's latest state; also samples the track.
  void setStatus(const Status& status);
  void setMissionInfo(const MissionInfo& info);
  // Takes a tile's latest content: those of its sixteen blocks that the ship lacks are sent, with an error of
  // at most `max_error` [m]; 0: as configured.
  void offer(const HeightTile& tile, std::int64_t now_ns, double max_error = 0);

  // Called for evicted squares (see BlockQueue::OnEvicted): the caller offers them again when hasRoom(),
  // those with `spare` when spare().
  void onEvicted(BlockQueue::OnEvicted on_evicted);
  [[nodiscard]] bool hasRoom() const;
  [[nodiscard]] bool spare() const;  // fewer blocks wait than a bundle takes, and no answers come
  // See BlockQueue::eachHeld().
  void eachHeld(const std::function<void(const BlockKey&, Version, Version, const MapBlock&)>& visit) const;

  // The ship's messages. Each of them, and received() for a frame with none, ends listening. `on_whole`,
  // unless empty, is called for every square of which the ship now has all of the present content.
  void acknowledge(const Acknowledgement& acknowledgement, std::int64_t now_ns,
                   const std::function<void(const BlockQueue::Whole&)>& on_whole = {});
  // `counter`: of the downlink frame that brought it.
  void request(const Request& request, std::int64_t now_ns, DownlinkCounter counter = 0);
  // The frame that an acknowledgement names, if it left within the last `within_s`.
  [[nodiscard]] std::optional<Version> sentLately(const Acknowledgement& a, std::int64_t now_ns,
                                                  double within_s) const;
  void received(std::int64_t now_ns);

  // The oldest request for detail that is not served yet; null: none. The caller offers tiles of its spacing
  // inside the rectangle, with its error, then calls detailServed().
  struct Detail {
    double north_min = 0, north_max = 0, east_min = 0, east_max = 0;  // nav [m]
    double spacing = 0, max_error = 0;                                // [m]
    RequestOutcome request;                                           // its outcome so far
  };
  [[nodiscard]] const Detail* detail() const;
  void detailServed();

  // Writes the next modem frame into `out` (at least frame_bytes, or modem_bytes where that is set) and
  // returns its size; 0 when there is nothing to send, the rate does not allow it yet or the vehicle listens.
  // A bundle takes link frames until there is nothing more to send, no room for another of 32 B, or one gives
  // the turn. Call again until 0. `now_ns` never runs backwards.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out);

  struct Counters {
    std::uint64_t frames = 0;  // link frames
    std::uint64_t bytes = 0;   // of modem frames, padding included
    std::uint64_t status_frames = 0, report_frames = 0, track_frames = 0, info_frames = 0;
    std::uint64_t map_frames = 0, repair_frames = 0;
    std::uint64_t map_bytes = 0;  // of map frames, frame overhead included
    std::uint64_t turns = 0;      // frames with the turn
    std::uint64_t acknowledgements = 0, acknowledgements_foreign = 0, requests = 0, requests_refused = 0;
    std::uint64_t frames_arrived = 0, frames_lost = 0;  // as acknowledged
    std::uint64_t reduced_packets = 0;  // sent without colour, or without some nodes, to fit a frame
    BlockQueue::Counters blocks;
    int squares_held = 0;          // in the pool
    int blocks_waiting = 0;        // to be sent
    int blocks_in_flight = 0;      // sent, unacknowledged
    double loss = 0;               // expected now
    double periods_stretched = 1;  // factor on the housekeeping periods
    double rate_bps = 0;
    bool paused = false;
  };
  [[nodiscard]] Counters counters() const;
  // Whether nothing of the map waits and all that was sent is acknowledged, or sent often enough where no
  // answers come.
  [[nodiscard]] bool drained() const;
  [[nodiscard]] std::size_t memoryBytes() const;  // of the pool and the buffers

  // The program has restarted from its saved state and may have sent frames since: skips their sequence
  // numbers, as the ship takes reused ones for a new dive's.
  void noteRestart();
  // The same from a caller that logs every frame that leaves: `next` is the first unused version (in older
  // logs its sequence number), and the last frame was given to the modem at `now_ns`. If that frame gave the
  // turn, the ship's time to answer begins then, however late the caller's inputs are.
  void noteSent(Version next, std::int64_t now_ns);

  // Saves and loads all but mission info, for the same configuration: the loaded scheduler continues with the
  // same frames, bit by bit. After a failed load() it must not be used.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Capacity of the scheduler's token bucket: two modem frames with their preambles, or one second at the rate,
// whichever is more [bit].
[[nodiscard]] std::size_t linkBucketBits(const LinkSchedulerConfig& config);

}  // namespace fathom::telemetry
