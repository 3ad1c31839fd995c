#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "recon/geometry/height_tile.hpp"
#include "telemetry/frame.hpp"
#include "telemetry/mission_info.hpp"
#include "telemetry/status.hpp"
#include "telemetry/tile_codec.hpp"

namespace fathom::telemetry {

struct LinkSchedulerConfig {
  LinkIdentity identity;
  double rate_bps = 300;   // 80 to 5400 on acoustic modems; 10 to 1e6 accepted [bit/s]
  int frame_bytes = 128;   // largest frame, 32 to 256 [B]
  double loss_rate = 0.1;  // share of frames expected to be lost, 0 to 0.9
  double delivery_goal =
      0.99;  // a tile is repeated until it has arrived with this probability, 0.5 to 0.99999
  double housekeeping_share =
      0.4;  // of the rate, for status, track and mission info; their periods stretch to keep it
  double status_period_s = 10;  // [s]
  double mission_info_period_s = 120;
  double track_interval_s = 5;  // between points of the track
  int track_points = 24;        // a track message carries this many of the last points
  int coarse_stride = 4;        // first sight of a tile: every 4th node (1, 2, 4, 8)
  int fine_stride = 1;          // then refined to this; equal to coarse_stride: no refinement
  double update_depth = 0.05;   // a node's change that makes a sent tile worth sending again [m]
  double settle_s = 8;   // a tile still growing in the camera's view waits this long after its last change
  int max_tiles = 1024;  // pool of tile copies, 4.7 kB each
  TileCodecConfig codec;

  void validate() const;  // throws std::invalid_argument naming the value
};

// Decides what crosses the acoustic link next. Sans-I/O and deterministic: the caller gives the time and
// sends the frames. A token bucket of two frames keeps the rate: over any window of W seconds no more than
// rate * W / 8 + 2 * frame_bytes bytes leave. Order of importance:
//   1 status, mission info and track when due (within their share of the rate);
//   2 tiles never sent, coarse, newest first;
//   3 tiles that changed since they were sent, the most changed nodes first;
//   4 repeats of coarse tiles until the delivery goal is reached (there are no acknowledgements);
//   5 refinement of tiles at the fine stride, newest first, then its repeats;
//   6 tiles that have not settled, the fullest first: the link is never idle while something is unsent.
// Tiles are copied into a fixed pool; when it is full the tile needed least gives way (delivered longest ago,
// else offered longest ago) and is counted. Nothing is allocated after construction except inside Draco.
class LinkScheduler {
 public:
  explicit LinkScheduler(const LinkSchedulerConfig& config);
  ~LinkScheduler();

  // The vehicle's latest state; also samples the track.
  void setStatus(const Status& status);
  void setMissionInfo(const MissionInfo& info);
  // A tile's latest content. An older or equal revision than the one held is ignored.
  void offer(const HeightTile& tile);

  // Writes the next frame into `out` (at least frame_bytes) and returns its size; 0 when there is nothing to
  // say or the rate does not allow it yet. Call again until 0. `now_ns` never runs backwards.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, std::span<std::uint8_t> out);

  struct Counters {
    std::uint64_t frames = 0, bytes = 0;
    std::uint64_t status_frames = 0, track_frames = 0, info_frames = 0, tile_frames = 0;
    std::uint64_t tiles_offered = 0;     // offers taken
    std::uint64_t tiles_sent = 0;        // complete transmissions, repeats included
    std::uint64_t tiles_evicted = 0;     // gave way to another in the full pool before they were delivered
    std::uint64_t tiles_unsendable = 0;  // would not fit the codec's bounds
    std::uint64_t tile_bytes = 0;        // of tile fragments, frame overhead included
    int tiles_held = 0;                  // in the pool
    int tiles_waiting = 0;               // in the pool and not yet delivered with the goal's probability
    double periods_stretched = 1;        // factor on the housekeeping periods
  };
  [[nodiscard]] Counters counters() const;
  [[nodiscard]] std::size_t memoryBytes() const;  // of the pool and the buffers

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Capacity of the scheduler's token bucket: two frames or one second at the rate, whichever is more [bit].
[[nodiscard]] std::size_t linkBucketBits(const LinkSchedulerConfig& config);

// How often a tile of `fragments` frames must be sent so that all of them arrive with probability >= goal
// when each frame is lost with probability `loss`: the least n with (1 - loss^n)^fragments >= goal.
[[nodiscard]] int repeatsForGoal(double loss, double goal, int fragments);

}  // namespace fathom::telemetry
