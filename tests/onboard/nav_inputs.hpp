#pragma once

#include "realtime/onboard/nav/nav_core.hpp"
#include "tests/world/analytic_dive.hpp"

// The inputs of a synthetic dive for NavCore.
namespace fathom::onboard::testing {

using namespace fathom::nav::test;

inline NavCoreConfig coreConfig() {
  NavCoreConfig config;
  config.odometry = mountedConfig();
  return config;
}

// Navigation samples, stereo exposures at 2 Hz (the right camera 4 ms later) and health ticks at 1 Hz, by
// time. Pair i is exposed at pairTime(i) and has the handles 2 i and 2 i + 1.
inline double pairTime(std::uint32_t i) {
  return 0.25 + 0.5 * i;
}
struct Exposure {
  std::int64_t utc_ns = 0;
  CameraSide side = CameraSide::kLeft;
  std::uint32_t frame_id = 0;
};
struct HealthTick {
  std::int64_t utc_ns = 0;
};
using Input =
    std::variant<DvlSample, AttitudeSample, GyroSample, DepthSample, WaterSample, Exposure, HealthTick>;

inline std::int64_t utcOf(const Input& input) {
  return std::visit([](const auto& i) { return i.utc_ns; }, input);
}
inline bool isDvl(const Input& input) {
  return std::holds_alternative<DvlSample>(input);
}
inline void give(NavCore& core, const Input& input) {
  std::visit(
      [&core](const auto& i) {
        using T = std::decay_t<decltype(i)>;
        if constexpr (std::is_same_v<T, Exposure>)
          core.addFrame(i.utc_ns, i.side, i.frame_id);
        else if constexpr (std::is_same_v<T, HealthTick>)
          core.tick(i.utc_ns);
        else
          core.add(i);
      },
      input);
}

inline std::vector<Input> diveInputs(double duration, const Rates& rates = {}) {
  std::vector<Input> inputs;
  for (const Sample& sample : samplesOf(circle, mountedConfig(), duration, rates))
    inputs.push_back(std::visit([](const auto& s) { return Input(s); }, sample));
  for (std::uint32_t i = 0; pairTime(i) + 0.01 < duration; ++i) {
    inputs.push_back(Exposure{at(pairTime(i)), CameraSide::kLeft, 2 * i});
    inputs.push_back(Exposure{at(pairTime(i) + 0.004), CameraSide::kRight, 2 * i + 1});
  }
  for (int i = 1; i < duration; ++i) inputs.push_back(HealthTick{at(i)});
  std::stable_sort(inputs.begin(), inputs.end(),
                   [](const Input& a, const Input& b) { return utcOf(a) < utcOf(b); });
  return inputs;
}

// A dive whose bottom track is away from one second to another.
inline std::vector<Input> withoutBottom(double duration, double from, double to) {
  std::vector<Input> inputs = diveInputs(duration);
  std::erase_if(inputs,
                [&](const Input& i) { return isDvl(i) && utcOf(i) >= at(from) && utcOf(i) <= at(to); });
  return inputs;
}

inline std::vector<StereoTrigger> run(NavCore& core, const std::vector<Input>& inputs) {
  std::vector<StereoTrigger> triggers;
  for (const Input& input : inputs) {
    give(core, input);
    while (const auto trigger = core.pollTrigger())
      if (trigger->pose != StereoTrigger::Pose::kPredicted) triggers.push_back(*trigger);
  }
  return triggers;
}

}  // namespace fathom::onboard::testing
