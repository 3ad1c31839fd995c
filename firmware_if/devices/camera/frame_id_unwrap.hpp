#pragma once

#include <cstdint>

namespace fathom::io {

// Turns the frame ids of GigE Vision cameras into a number that only grows: 16-bit ids go 1, 2 ...
// 65535, 1 (0 is never used), 64-bit ids of GigE Vision 2 as they are.
//
// The time stamp, not the id, shows whether a frame is new. An id further from the one before than there can
// have been exposures is a jump: counting continues by one from there.
class FrameIdUnwrap {
 public:
  struct Step {
    std::uint64_t id = 0;      // grows by one an exposure
    std::uint64_t missed = 0;  // ids between the newest and this one that never came
    bool jumped = false;
  };

  // The id of a frame newer than every one before it. `most_missed`: more than so many cannot have been
  // exposed in between.
  [[nodiscard]] Step add(std::uint64_t device_id, std::uint64_t most_missed) noexcept {
    if (device_id > kLast16) wide_ = true;
    const std::uint64_t ahead = wide_ ? device_id - device_ : (device_id + kLast16 - device_) % kLast16;
    device_ = device_id;
    if (!any_ || restarted_) {
      // A camera that started again may count from any number; here the next number follows.
      newest_ = any_ ? newest_ + 1 : device_id;
      any_ = true;
      restarted_ = false;
      return {newest_, 0, false};
    }
    if (ahead == 0 || ahead - 1 > most_missed) return {++newest_, 0, true};
    newest_ += ahead;
    return {newest_, ahead - 1, false};
  }

  // The camera was started again: so were its ids.
  void restart() noexcept { restarted_ = true; }

 private:
  static constexpr std::uint64_t kLast16 = 65535;
  bool any_ = false, restarted_ = false, wide_ = false;
  std::uint64_t device_ = 0;  // newest as the device has it
  std::uint64_t newest_ = 0;
};

}  // namespace fathom::io
