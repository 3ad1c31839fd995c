#include "firmware_if/log/live_input.hpp"

#include <type_traits>

#include "firmware_if/image_file.hpp"

namespace fathom::io {

OnboardInput onboardInput(const LiveInput& input) {
  OnboardInput logged;
  logged.arrival_utc_ns = input.arrival_utc_ns;
  std::visit(
      [&](const auto& what) {
        using T = std::decay_t<decltype(what)>;
        if constexpr (std::is_same_v<T, DeviceSample>)
          std::visit([&](const auto& sample) { logged.what = SensorSample(sample); }, what);
        else if constexpr (std::is_same_v<T, ImageStamp>)
          logged.what = SensorSample(
              ImageEvent{what.utc_ns, what.side, imageFileName(what.utc_ns, what.side), what.exposure_s});
        else
          logged.what = what;
      },
      input.what);
  return logged;
}

}  // namespace fathom::io
