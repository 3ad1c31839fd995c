#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/wire/track.hpp"

namespace fathom::telemetry {

// The points of the dive's track, each with the last frame that carried it and whether the ship has it. Every
// track message carries the newest points; lost ones are sent again in spare time. Bounded: of more than
// kMost points the oldest are dropped. Only the constructor allocates.
class TrackLog {
 public:
  static constexpr std::size_t kMost = 4096;  // five hours at 5 s

  TrackLog() { points_.reserve(kMost); }

  // Adds a point later than the last; an earlier one (the clock was set back) starts a new track.
  void add(const TrackPoint& point);
  [[nodiscard]] bool empty() const { return points_.empty(); }
  [[nodiscard]] std::int64_t newestUtcNs() const { return points_.back().at.utc_ns; }

  // Writes a message of at most `most` points, the newest or those around the oldest lost one, to be sent
  // with frame `version`; 0: none.
  [[nodiscard]] std::size_t newest(std::size_t most, Version version, std::span<std::uint8_t> out);
  [[nodiscard]] std::size_t lost(std::size_t most, Version version, std::span<std::uint8_t> out);

  // The outcome of one frame; and of all earlier frames (see BlockQueue::settle).
  void word(Version version, bool arrived);
  void settle(const BlockQueue::Holds& holds, Version oldest);

  [[nodiscard]] std::size_t memoryBytes() const { return points_.capacity() * sizeof(Point); }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t size = self.points_.size();
    archive(size);
    archive.require(size <= kMost, "more of a track than there is room for");
    if constexpr (Archive::kLoading) {
      if (!archive.ok()) return;
      self.points_.resize(size);
    }
    for (auto& p : self.points_) {
      archive.instants(p.at.utc_ns);
      archive(p.at.north, p.at.east, p.at.depth, p.last, p.confirmed, p.lost);
    }
  }

 private:
  struct Point {
    TrackPoint at;
    Version last = 0;  // frame; 0: none
    bool confirmed = false, lost = false;
  };
  std::size_t encode(std::size_t first, std::size_t count, Version version, std::span<std::uint8_t> out);

  std::vector<Point> points_;  // oldest first
};

}  // namespace fathom::telemetry
