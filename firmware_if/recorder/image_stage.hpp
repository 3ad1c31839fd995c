#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "realtime/base/files/descriptor.hpp"
#include "realtime/kernel/rings/fixed_queue.hpp"
#include "realtime/kernel/rings/spsc_ring.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// One camera's exposures that wait for the disk, and the outcome of those that no input has named yet.
class ImageLane {
 public:
  static constexpr std::size_t kCapacity = 64;

  explicit ImageLane(std::size_t most_waiting) : most_waiting_(most_waiting) {}

  // Producer only; wait-free. False when too many wait.
  [[nodiscard]] bool offer(const CameraFrame& frame) noexcept {
    if (ring_.used() < most_waiting_ && ring_.push(frame)) return true;
    refused_.store(refused_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    return false;
  }

  // The rest: consumer only.
  [[nodiscard]] bool waiting() const noexcept { return ring_.used() > 0; }
  [[nodiscard]] bool take(CameraFrame& frame) noexcept { return ring_.pop(frame); }
  // Remembers what became of a frame; true when that pushed out one that no input named.
  bool settle(std::int64_t utc_ns, bool written) noexcept {
    return settled_.pushDroppingOldest({utc_ns, written});
  }

  enum class State : std::uint8_t { kWritten, kLost, kWaiting };
  // Of the exposure that an input names. Frames settled before it are left behind: no input named them.
  [[nodiscard]] State stateOf(std::int64_t utc_ns) const noexcept {
    for (std::size_t i = 0; i < settled_.size(); ++i)
      if (settled_[i].utc_ns == utc_ns) return settled_[i].written ? State::kWritten : State::kLost;
    return waiting() ? State::kWaiting : State::kLost;
  }
  // Forgets it and those before; gives how many of these were written without an input.
  std::uint64_t forget(std::int64_t utc_ns) noexcept {
    std::uint64_t unnamed = 0;
    for (std::size_t i = 0; i < settled_.size(); ++i) {
      if (settled_[i].utc_ns != utc_ns) continue;
      for (std::size_t before = 0; before < i; ++before) unnamed += settled_[before].written ? 1 : 0;
      for (std::size_t gone = 0; gone <= i; ++gone) settled_.popFront();
      break;
    }
    return unnamed;
  }

  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t highWater() const noexcept { return ring_.highWater(); }

 private:
  struct Settled {
    std::int64_t utc_ns = 0;
    bool written = false;
  };
  std::size_t most_waiting_;
  rt::SpscRing<CameraFrame, kCapacity> ring_;
  std::atomic<std::uint64_t> refused_{0};
  rt::FixedQueue<Settled, kCapacity> settled_;  // oldest first
};

// The head of an uncompressed TIFF. The pixels follow as they are in memory, so that an image goes to the
// disk straight from the camera's block: no copy, no heap, and its size is known before it is written.
// (Deflate of sensor noise saves a quarter of the bytes and takes 80 ms for 1360 x 1024 of 12 bits: a third
// of a core for two cameras at 2 Hz.) TIFF 6.0, strips of whole rows, the machine's little endian.
constexpr std::size_t kTiffHeadBytes = 4096;  // a page, so that the pixels begin on one
using TiffHead = std::array<std::uint8_t, kTiffHeadBytes>;

// `image` is not empty, 8 or 16 bit samples, one channel or RGB.
[[nodiscard]] TiffHead tiffHead(const ImageView& image);
[[nodiscard]] std::size_t rowBytes(const ImageView& image);
[[nodiscard]] std::size_t tiffBytes(const ImageView& image);  // of the whole file

// Images into img/, each whole under its name or not there at all, whatever happens to the machine: written
// under "<name>.tmp" into blocks taken beforehand, synced to the disk, renamed, and the folder synced. The
// pages are dropped from the system's cache, so that five hours of images do not displace other memory. The
// folder is opened by the first image that finds it there.
class ImageWriter {
 public:
  explicit ImageWriter(std::filesystem::path folder) : path_(std::move(folder)) {}
  ~ImageWriter() { discard(); }
  ImageWriter(const ImageWriter&) = delete;
  ImageWriter& operator=(const ImageWriter&) = delete;

  // Writes an image and lets the disk begin with it. False, with nothing left of it, when the disk refuses or
  // a file of that name is there already.
  [[nodiscard]] bool write(const std::string& name, const ImageView& image) noexcept;
  // Waits for the disk to hold all images written since the last call, and gives them their names; false:
  // none of them is there.
  [[nodiscard]] bool commit() noexcept;
  // errno of the last image that was refused.
  [[nodiscard]] int error() const noexcept { return error_; }

  [[nodiscard]] std::uint64_t bytes() const noexcept { return bytes_; }  // of committed files

 private:
  struct Pending {
    Descriptor file;
    std::string name;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] bool refused(int error) noexcept;
  void discard() noexcept;

  std::filesystem::path path_;
  Descriptor folder_;
  int error_ = 0;
  std::vector<Pending> pending_;
  std::uint64_t bytes_ = 0;
};

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
