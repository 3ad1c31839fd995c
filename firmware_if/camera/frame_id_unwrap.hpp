#pragma once

#include <cstdint>

namespace fathom::io {

// Frame ids as GigE Vision cameras send them, made into a number that only grows: 16-bit ids go 1, 2 ...
// 65535, 1 (0 is never used), 64-bit ids of GigE Vision 2 as they are. An id below or equal to the newest is
// an old frame, not a wrap, when it lies less than half a turn back.
class FrameIdUnwrap {
 public:
  struct Step {
    std::uint64_t id = 0;      // grows by one an exposure
    std::uint64_t missed = 0;  // ids between the newest and this one that never came
    bool fresh = true;         // false: not newer than the newest
  };

  [[nodiscard]] Step add(std::uint64_t device_id) noexcept {
    if (device_id > kLast16) wide_ = true;
    if (!any_ || restarted_) {
      // Where a camera that started again counts from is its own affair; here the next number follows.
      const std::uint64_t id = any_ ? newest_ + 1 : device_id;
      any_ = true;
      restarted_ = false;
      device_ = device_id;
      newest_ = id;
      return {id, 0, true};
    }
    const std::uint64_t turn = wide_ ? 0 : kLast16;  // 0: 2^64, by the arithmetic
    std::uint64_t ahead = device_id - device_;
    if (turn != 0) ahead = (device_id + turn - device_) % turn;
    const std::uint64_t half = turn == 0 ? std::uint64_t{1} << 63 : turn / 2;
    if (ahead == 0) return {newest_, 0, false};
    if (ahead > half) return {newest_ - (turn - ahead), 0, false};
    device_ = device_id;
    newest_ += ahead;
    return {newest_, ahead - 1, true};
  }

  // The camera was started again: its ids begin anew.
  void restart() noexcept { restarted_ = true; }

 private:
  static constexpr std::uint64_t kLast16 = 65535;
  bool any_ = false, restarted_ = false, wide_ = false;
  std::uint64_t device_ = 0;  // newest as the device has it
  std::uint64_t newest_ = 0;
};

}  // namespace fathom::io
