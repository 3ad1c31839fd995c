#pragma once

#include <cstdint>
#include <type_traits>
#include <variant>

#include "realtime/onboard/nav/nav_core.hpp"
#include "recon/navigation/dead_reckoning/camera_clock.hpp"

namespace fathom::onboard {

// NavCore with its input stage: numbers the exposures and converts their stamps to vehicle time. The same
// calls give the same state, bit for bit: the hard tier has one for poses and health at 100 Hz, the soft tier
// another that follows the same inputs, so that it finds the pose of any moment without asking the hard tier.
// Allocates nothing after construction.
class NavFeed {
 public:
  explicit NavFeed(const NavCoreConfig& config) : core_(config) {}

  template <class Sample>
  void add(const Sample& sample) noexcept {
    core_.add(sample);
  }
  // Whatever navigation has a use for; the rest is passed over.
  void add(const SensorSample& sample, std::int64_t arrival_utc_ns) noexcept {
    std::visit(
        [&](const auto& s) noexcept {
          using Sample = std::decay_t<decltype(s)>;
          if constexpr (std::is_same_v<Sample, ImageEvent>)
            (void)addExposure(s.utc_ns, s.side, arrival_utc_ns);
          else if constexpr (requires { core_.add(s); })
            core_.add(s);
        },
        sample);
  }
  // An exposure stamped `stamp_utc_ns` that arrived then; returns its number, from 0.
  std::uint32_t addExposure(std::int64_t stamp_utc_ns, CameraSide side,
                            std::int64_t arrival_utc_ns) noexcept {
    nav::CameraClock& clock = side == CameraSide::kLeft ? left_clock_ : right_clock_;
    core_.addFrame(clock.utcNs(stamp_utc_ns, arrival_utc_ns), side, exposures_);
    return exposures_++;
  }
  void tick(std::int64_t now_ns) noexcept { core_.tick(now_ns); }

  [[nodiscard]] NavCore& core() noexcept { return core_; }
  [[nodiscard]] const NavCore& core() const noexcept { return core_; }
  [[nodiscard]] const nav::CameraClock& leftClock() const noexcept { return left_clock_; }
  [[nodiscard]] const nav::CameraClock& rightClock() const noexcept { return right_clock_; }
  [[nodiscard]] std::uint32_t exposures() const noexcept { return exposures_; }

  // Bit by bit, into one of the same configuration.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  NavCore core_;
  nav::CameraClock left_clock_, right_clock_;
  std::uint32_t exposures_ = 0;
};

}  // namespace fathom::onboard
