#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/recorder/image_lane.hpp"
#include "firmware_if/recorder/image_writer.hpp"

namespace fathom::io {

// Both cameras' exposures onto the disk, as long as there is room and the disk is quick enough for them; each
// frame's hold is given back, written or not.
class ImageStage {
 public:
  using ViewOf = std::function<ImageView(const CameraFrame&)>;
  using Release = std::function<void(const CameraFrame&)>;
  struct Counters {
    std::uint64_t written = 0, dropped_slow = 0, dropped_disk = 0, without_input = 0, failures = 0;
  };

  ImageStage(const std::filesystem::path& folder, std::size_t most_waiting, ViewOf view_of, Release release);

  // Each camera's own thread.
  bool offer(const CameraFrame& frame) noexcept;

  // The rest: the recorder's thread only. Writes at most one exposure of each camera, so that the log is
  // never kept waiting long; with `room` false they are dropped.
  void step(bool room);
  [[nodiscard]] bool waiting() const noexcept { return lanes_[0].waiting() || lanes_[1].waiting(); }
  // That the last ones took.
  [[nodiscard]] std::int64_t timeNs() const noexcept { return time_ns_; }
  [[nodiscard]] ImageLane::State stateOf(CameraSide side, std::int64_t utc_ns) const noexcept {
    return lanes_[static_cast<std::size_t>(side)].stateOf(utc_ns);
  }
  // An input named it: what was settled before it has none.
  void named(CameraSide side, std::int64_t utc_ns) noexcept;
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }
  // Why the disk did not take the newest that it was asked to take, an errno; 0: it did.
  [[nodiscard]] int error() const noexcept { return error_; }
  [[nodiscard]] std::uint64_t bytes() const noexcept { return writer_.bytes(); }

  // Any thread: frames refused for want of room in a queue, and the most that waited.
  [[nodiscard]] std::uint64_t refused() const noexcept { return lanes_[0].refused() + lanes_[1].refused(); }
  [[nodiscard]] std::size_t highWater() const noexcept;

 private:
  [[nodiscard]] ImageLane& laneOf(CameraSide side) noexcept { return lanes_[static_cast<std::size_t>(side)]; }
  [[nodiscard]] bool write(const CameraFrame& frame);

  ViewOf view_of_;
  Release release_;
  ImageWriter writer_;
  std::array<ImageLane, 2> lanes_;
  std::int64_t time_ns_ = 0;
  int error_ = 0;
  Counters counters_;
};

}  // namespace fathom::io
