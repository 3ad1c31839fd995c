#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "tests/world/dive.hpp"

namespace fathom::slam::testing {

// A dive with outliers of one or two sensors.
struct HostileDive {
  std::string name;
  SyntheticDiveOptions options;
};

// Greatest horizontal error of a keyframe [m]: on board when it was the
// newest and after the dive, and topside.
struct HostileErrors {
  double live = 0, after = 0, topside = 0;
};
struct HostileRun {
  HostileErrors all, clean;  // `clean`: of the same dive without its outliers
};

inline NavigationConfig configFor(std::size_t keyframes) {
  NavigationConfig config;
  config.max_keyframes = static_cast<int>(keyframes) + 64;  // none retires
  config.max_links = 3 * config.max_keyframes;
  config.max_fixes = config.max_keyframes;
  return config;
}

inline double greatestError(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  double most = 0;
  for (std::size_t k = 0; k < poses.size(); ++k)
    most = std::max(most, (poses[k].translation() - truth[k].translation()).head<2>().norm());
  return most;
}

// The dive without its outliers: left out, or marked as absent.
inline SyntheticDive withoutOutliers(const SyntheticDive& survey) {
  SyntheticDive clean = survey;
  for (std::size_t k = 0; k < clean.inputs.size(); ++k) {
    KeyframeInput& input = clean.inputs[k];
    input.attitude_held = input.attitude_held || clean.anomalous[k];
    if (clean.wrong_scale[k] && k > 0)
      input.unlocked_s = static_cast<double>(input.utc_ns - clean.inputs[k - 1].utc_ns) * 1e-9;
  }
  std::vector<SyntheticDive::Link> visual;
  for (std::size_t i = 0; i < clean.visual.size(); ++i)
    if (std::find(clean.false_visual.begin(), clean.false_visual.end(), static_cast<int>(i)) ==
        clean.false_visual.end())
      visual.push_back(clean.visual[i]);
  std::vector<SyntheticDive::Fix> fixes;
  for (std::size_t i = 0; i < clean.fixes.size(); ++i)
    if (std::find(clean.biased.begin(), clean.biased.end(), i) == clean.biased.end())
      fixes.push_back(clean.fixes[i]);
  clean.visual = visual;
  clean.fixes = fixes;
  return clean;
}

inline std::vector<SE3> solvedTopside(const SyntheticDive& survey, const SyntheticDiveOptions& o) {
  Measured measured = measuredOf(survey, o.usbl_sigma);
  return solveNavigation(configFor(survey.inputs.size()), survey.inputs, survey.anchor, o.anchor_sigma,
                         measured.links, measured.fixes)
      .poses;
}

inline HostileErrors errorsOn(const SyntheticDive& survey, const SyntheticDiveOptions& o) {
  HostileErrors out;
  NavigationGraph graph(configFor(survey.inputs.size()));
  graph.setAnchor(survey.anchor, o.anchor_sigma);
  std::vector<SE3> poses;
  for (int k = 1; k <= static_cast<int>(survey.inputs.size()); ++k) {
    driveOn(graph, survey, o, k);
    poses.push_back(graph.pose(k - 1));
  }
  out.live = greatestError(poses, survey.truth);
  for (int i = 0; i < 30; ++i) (void)graph.step();
  for (int k = 0; k < graph.keyframes(); ++k) poses[static_cast<std::size_t>(k)] = graph.pose(k);
  out.after = greatestError(poses, survey.truth);
  out.topside = greatestError(solvedTopside(survey, o), survey.truth);
  return out;
}

// Lines of 200 s with correct DVL and visual odometry but for: smooth anomalies
// of the compass, false visual links, steps of the DVL's scale, a USBL that errs
// by 5 m for ten minutes, a minute without DVL; each with and without USBL.
[[nodiscard]] inline std::vector<HostileDive> hostileDives() {
  SyntheticDiveOptions line{.lines = 2};
  line.line_length = 100;  // 200 s
  line.closure_share = 0;
  line.usbl_period = 1e9;
  std::vector<HostileDive> dives;
  const auto add = [&](const std::string& name, auto&& change) {
    for (const bool usbl : {false, true}) {
      SyntheticDiveOptions o = line;
      change(o);
      if (usbl) o.usbl_period = 10;
      dives.push_back({name + (usbl ? ", USBL" : ", no USBL"), o});
    }
  };
  const auto bump = [](SyntheticDiveOptions& o, double degrees, double sigma) {
    o.bump_at = 110;
    o.bump = degrees * kRadiansPerDegree;
    o.bump_sigma = sigma;
  };
  add("compass 10 deg, 3 s", [&](auto& o) { bump(o, 10, 3); });
  add("compass 20 deg, 5 s", [&](auto& o) { bump(o, 20, 5); });
  add("compass 40 deg, 12 s", [&](auto& o) { bump(o, 40, 12); });
  add("one false link", [](auto& o) { o.false_links = 1, o.false_shift = 0.15; });
  add("false links, compass 20 deg, 5 s", [&](auto& o) {
    o.false_links = 3;
    o.false_shift = 0.15;
    bump(o, 20, 5);
  });
  add("DVL scale 3 %", [](auto& o) {
    o.scale_at = 90;
    o.scale_step = 0.03;
  });
  add("DVL scale 15 %", [](auto& o) {
    o.scale_at = 90;
    o.scale_step = 0.15;
  });
  add("60 s without DVL", [](auto& o) {
    o.dvl_dead_from = 100;
    o.dvl_dead_to = 160;
  });
  add("60 s without DVL, compass 20 deg, 5 s", [&](auto& o) {
    o.dvl_dead_from = 80;
    o.dvl_dead_to = 140;
    bump(o, 20, 5);
  });
  SyntheticDiveOptions biased = line;
  biased.lines = 6;
  biased.usbl_period = 10;
  biased.bias_from = 300;
  biased.bias_to = 900;
  biased.bias = {3, -4};
  dives.push_back({"USBL 5 m off for ten minutes", biased});
  return dives;
}

[[nodiscard]] inline HostileRun runHostile(const HostileDive& dive, std::uint64_t seed) {
  SyntheticDiveOptions o = dive.options;
  o.seed = seed;
  const SyntheticDive survey = makeDive(o);
  return {errorsOn(survey, o), errorsOn(withoutOutliers(survey), o)};
}

}  // namespace fathom::slam::testing
