#pragma once

#include <cstdint>

namespace fathom::io {

// What may still be written with so much room on the disk. A step down is taken at once, a step back up only
// when there is an eighth more room than the reserve, so that a disk at the edge does not flicker.
class DiskGuard {
 public:
  enum class Level : std::uint8_t { kRoom, kImagesStopped, kRawStopped };

  DiskGuard(double image_reserve_mib, double log_reserve_mib)
      : image_reserve_(image_reserve_mib), log_reserve_(log_reserve_mib) {}

  Level update(double free_mib) {
    constexpr double kBackUp = 1.125;
    const bool raw = free_mib < log_reserve_ * (level_ == Level::kRawStopped ? kBackUp : 1.0);
    const bool images = free_mib < image_reserve_ * (level_ != Level::kRoom ? kBackUp : 1.0);
    level_ = raw ? Level::kRawStopped : images ? Level::kImagesStopped : Level::kRoom;
    return level_;
  }
  [[nodiscard]] Level level() const { return level_; }

 private:
  double image_reserve_, log_reserve_;  // [MiB]
  Level level_ = Level::kRoom;
};

}  // namespace fathom::io
