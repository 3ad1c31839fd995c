#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::onboard {

// One input of NavCore: a sensor sample, the stamp of one exposure, or the tick at which health is asked for.
// Of fixed size and trivially copyable, so that it crosses rings and is logged as it is; made by navInput()
// and read by NavCore only.
struct NavInput {
  enum class Kind : std::uint8_t { kDvl, kAttitude, kDepth, kWater, kFrame, kHealthTick, kGyro };

  Kind kind = Kind::kHealthTick;
  CameraSide side = CameraSide::kLeft;  // kFrame
  std::uint8_t present = 0;             // bits: which optional values are there (nav_input.cpp)
  std::uint8_t unused = 0;              // keeps the bytes defined
  std::uint32_t frame_id = 0;           // kFrame: a handle that the caller resolves to the pixels
  std::int64_t utc_ns = 0;
  std::array<double, 9> values{};  // SI units, by kind (nav_input.cpp)
};
static_assert(std::is_trivially_copyable_v<NavInput> && sizeof(NavInput) == 88);

[[nodiscard]] NavInput navInput(const DvlSample& sample) noexcept;
[[nodiscard]] NavInput navInput(const AttitudeSample& sample) noexcept;
[[nodiscard]] NavInput navInput(const GyroSample& sample) noexcept;
[[nodiscard]] NavInput navInput(const DepthSample& sample) noexcept;
[[nodiscard]] NavInput navInput(const WaterSample& sample) noexcept;  // sound speed only
[[nodiscard]] NavInput frameInput(std::int64_t utc_ns, CameraSide side, std::uint32_t frame_id) noexcept;
[[nodiscard]] NavInput healthTickInput(std::int64_t utc_ns) noexcept;

// The samples again, from an input of that kind.
[[nodiscard]] DvlSample dvlSample(const NavInput& input) noexcept;
[[nodiscard]] AttitudeSample attitudeSample(const NavInput& input) noexcept;
[[nodiscard]] GyroSample gyroSample(const NavInput& input) noexcept;
[[nodiscard]] DepthSample depthSample(const NavInput& input) noexcept;
[[nodiscard]] WaterSample waterSample(const NavInput& input) noexcept;

}  // namespace fathom::onboard
