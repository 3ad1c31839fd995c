#pragma once

#include <cstdint>
#include <variant>

#include "firmware_if/log/onboard_input.hpp"

namespace fathom::io {

// An exposure as the hard tier passes it on. Its file's name is imageFileName(utc_ns, side), made where the
// heap may be used; `utc_ns` is that of the CameraFrame, unchanged, since the recorder finds the pixels by
// it.
struct ImageStamp {
  std::int64_t utc_ns = 0;
  CameraSide side = CameraSide::kLeft;
  double exposure_s = 0;
};

// OnboardInput without anything that owns memory: copying it never throws and never calls the heap, so that
// it crosses the rings of the hard tier.
struct LiveInput {
  using What = std::variant<DeviceSample, ImageStamp, ModemFrame, Tick, Decision, Mark>;

  LiveInput() noexcept = default;
  LiveInput(std::int64_t arrival, const What& input) noexcept : arrival_utc_ns(arrival), what(input) {}
  LiveInput(const LiveInput&) noexcept = default;
  LiveInput& operator=(const LiveInput&) noexcept = default;

  std::int64_t arrival_utc_ns = 0;
  What what = Tick{};
};

// The same as it is logged. Takes memory.
[[nodiscard]] OnboardInput onboardInput(const LiveInput& input);

}  // namespace fathom::io
