#include "tests/onboard/live/shuttle.hpp"

#include <algorithm>
#include <functional>
#include <variant>

namespace fathom::test {
namespace {

// A sample with another time, as `time` says for each of its time stamps; DVL velocities times `direction`.
SensorSample moved(SensorSample sample, const std::function<std::int64_t(std::int64_t)>& time,
                   double direction) {
  std::visit(
      [&](auto& s) {
        using Sample = std::decay_t<decltype(s)>;
        const std::int64_t before = s.utc_ns;
        s.utc_ns = time(before);
        if constexpr (std::is_same_v<Sample, UsblFix>) s.arrival_utc_ns += s.utc_ns - before;
        if constexpr (std::is_same_v<Sample, DvlSample>)
          if (s.velocity) *s.velocity *= direction;
      },
      sample);
  return sample;
}

std::int64_t timeOf(const SensorSample& sample) {
  return std::visit([](const auto& s) { return s.utc_ns; }, sample);
}

}  // namespace

Shuttle::Shuttle(const std::vector<io::OnboardInput>& inputs, std::size_t pairs) {
  std::int64_t begin = 0, end = 0;
  std::vector<Step> forward;
  for (const io::OnboardInput& input : inputs) {
    const auto* sample = std::get_if<SensorSample>(&input.what);
    if (sample == nullptr) continue;
    if (forward.empty()) begin = timeOf(*sample);
    if (const auto* image = std::get_if<ImageEvent>(sample)) {
      auto& names = images_[static_cast<std::size_t>(image->side)];
      if (images_[0].size() >= pairs && images_[1].size() >= pairs) break;
      if (names.size() >= pairs) continue;
      names.push_back(image->file_name);
    }
    end = std::max(end, timeOf(*sample));
    forward.push_back({input.arrival_utc_ns, *sample});
  }
  // A pause between two legs as between two exposures, so that the last pair is not taken twice at once.
  constexpr std::int64_t kPauseNs = 500'000'000;
  leg_ns_ = end - begin + kPauseNs;
  for (const Step& step : forward) {
    const std::int64_t late = std::max<std::int64_t>(step.arrival_ns - timeOf(step.sample), 0);
    const auto ahead = [&](std::int64_t utc) { return utc - begin; };
    const auto back = [&](std::int64_t utc) { return end - utc; };
    for (const bool forth : {true, false}) {
      Step moved_step;
      moved_step.sample = forth ? moved(step.sample, ahead, 1.0) : moved(step.sample, back, -1.0);
      moved_step.arrival_ns = std::clamp<std::int64_t>(timeOf(moved_step.sample) + late, 0, leg_ns_);
      legs_[forth ? 0 : 1].push_back(std::move(moved_step));
    }
  }
  for (auto& leg : legs_)
    std::stable_sort(leg.begin(), leg.end(),
                     [](const Step& a, const Step& b) { return a.arrival_ns < b.arrival_ns; });
}

Shuttle::Step Shuttle::at(std::uint64_t number) const {
  const std::uint64_t leg = number / stepsOfLeg();
  const auto begin = static_cast<std::int64_t>(leg) * leg_ns_;
  Step step = legs_[leg % 2][static_cast<std::size_t>(number % stepsOfLeg())];
  step.arrival_ns += begin;
  step.sample = moved(
      std::move(step.sample), [begin](std::int64_t t) { return t + begin; }, 1.0);
  return step;
}

}  // namespace fathom::test
