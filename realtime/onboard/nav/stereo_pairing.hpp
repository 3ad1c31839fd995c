#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "realtime/kernel/rings/fixed_queue.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/navigation/dead_reckoning/sensor_history.hpp"

namespace fathom::onboard {

// Pairs each exposure of one camera with the nearest of the other within a tolerance. The two streams may
// arrive in any order relative to each other; each is ordered in time. Fixed memory.
//
// The cameras' clocks drift apart (+-50 ppm each give 0.36 s per hour), so the tolerance is relative to a
// skew, right less left, that tracks the pairs found: each pair moves it by an eighth of its residual, at
// most by the possible drift of two clocks since the previous pair. A camera that exposes late leaves the
// skew unchanged. After a time without pairs (a descent since `start_ns`, or cameras switched off) the
// tolerance is wider by the possible drift in that time, and the first pair sets the skew; but not where that
// leaves two candidate frames (at 2 Hz after 20 minutes).
class StereoPairing {
 public:
  struct Frame {
    std::int64_t utc_ns = 0;
    std::uint32_t frame_id = 0;

    static void exchange(auto& archive, auto& self) { archive(self.utc_ns, self.frame_id); }
  };
  struct Pair {
    Frame left, right;

    static void exchange(auto& archive, auto& self) { archive(self.left, self.right); }
  };

  // `tolerance_ns`: largest difference of exposure times of a pair; below half the time between frames.
  // `start_ns`: when the clocks' offsets were known; 0: at the first frames.
  explicit StereoPairing(std::int64_t tolerance_ns, std::int64_t start_ns = 0) noexcept
      : tolerance_ns_(tolerance_ns), newest_pair_ns_(start_ns) {}

  // The pair that this frame completes, if it does.
  [[nodiscard]] std::optional<Pair> add(CameraSide side, const Frame& frame) noexcept;

  // Frames given up without a partner; and frames refused because their time did not grow or leapt far ahead.
  [[nodiscard]] std::uint64_t unpaired(CameraSide side) const noexcept { return of(side).unpaired; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return refused_; }
  [[nodiscard]] std::int64_t skewNs() const noexcept { return skew_ns_; }  // right less left, followed

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) {
    archive(self.skew_ns_, self.newest_pair_ns_, self.period_ns_, self.streams_, self.refused_);
  }

 private:
  // Enough for one camera 16 frames behind the other; then the oldest is given up.
  static constexpr std::size_t kWaiting = 16;
  struct Stream {
    nav::TimeGate times;
    rt::FixedQueue<Frame, kWaiting> waiting;
    std::uint64_t unpaired = 0;

    static void exchange(auto& archive, auto& self) { archive(self.times, self.waiting, self.unpaired); }
  };
  // That two clocks may have drifted apart since the newest pair.
  [[nodiscard]] std::int64_t driftAt(std::int64_t utc_ns) const noexcept;
  void followSkew(const Pair& pair) noexcept;
  [[nodiscard]] const Stream& of(CameraSide side) const noexcept {
    return streams_[static_cast<std::size_t>(side)];
  }

  static constexpr std::int64_t kSkewFollow = 8;  // a pair moves the skew by this part of its residual
  static constexpr std::int64_t kDriftShare =
      5000;  // of a time, that two clocks of 100 ppm drift apart in it
  std::int64_t tolerance_ns_;
  std::int64_t skew_ns_ = 0;
  std::int64_t newest_pair_ns_;  // left exposure; before there is one: start_ns
  std::int64_t period_ns_ = 0;   // between frames of a camera, the shortest; 0: not known
  std::array<Stream, 2> streams_;
  std::uint64_t refused_ = 0;
};

}  // namespace fathom::onboard
