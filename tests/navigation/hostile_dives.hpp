#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/navigation/synthetic_dive.hpp"

namespace fathom::slam::testing {

// A dive with outliers of one or two sensors.
struct HostileDive {
  std::string name;
  SyntheticDiveOptions options;
};

// Lines of 200 s with correct DVL and visual odometry but for: smooth anomalies
// of the compass, false visual links, steps of the DVL's scale, a USBL that errs
// by 5 m for ten minutes, a minute without DVL; each with and without USBL.
[[nodiscard]] std::vector<HostileDive> hostileDives();

// Greatest horizontal error of a keyframe [m]: on board when it was the
// newest and after the dive, and topside.
struct HostileErrors {
  double live = 0, after = 0, topside = 0;
};
struct HostileRun {
  HostileErrors all, clean;  // `clean`: of the same dive without its outliers
};
[[nodiscard]] HostileRun runHostile(const HostileDive& dive, std::uint64_t seed);

}  // namespace fathom::slam::testing
