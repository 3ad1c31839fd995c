#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::onboard {

// Lends one camera's frames to the mapper: their blocks stay held until the mapper has passed them. At most
// `most` at once: newer frames are not lent to a mapper that stalls or is absent, which reads them from the
// disk later; neither camera nor recorder waits. Used by the camera's thread only.
class FrameLender {
 public:
  // The pool must outlive it. `most`: well below the pool's blocks.
  FrameLender(io::CameraSource& camera, FrameBroadcast& to, const std::atomic<std::uint64_t>& floor,
              std::size_t most);
  ~FrameLender();
  FrameLender(const FrameLender&) = delete;
  FrameLender& operator=(const FrameLender&) = delete;

  // Takes the caller's hold on the frame.
  void lend(const io::CameraFrame& frame) noexcept;

  // Frames that were not lent because the mapper still held too many; from any thread.
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kMost = 64;  // of any pool
  struct Loan {
    std::uint32_t block = 0;
    std::uint64_t number = 0;
  };
  void takeBack() noexcept;

  io::CameraSource& camera_;
  FrameBroadcast& to_;
  const std::atomic<std::uint64_t>& floor_;
  std::size_t most_;
  std::array<Loan, kMost> loans_{};  // oldest first, from begin_
  std::size_t begin_ = 0, count_ = 0;
  std::atomic<std::uint64_t> refused_{0};
};

}  // namespace fathom::onboard
