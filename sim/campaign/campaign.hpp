#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sim/campaign/dive_plan.hpp"

namespace fathom::sim {

// A campaign replays many disturbed simulated dives through fathom-onboard and fathom-topside, to find which
// perturbations, and which of them together, break which requirement.
struct CampaignOptions {
  std::filesystem::path out;
  std::filesystem::path programs;  // folder of fathom-onboard and fathom-topside
  DiveSeries series = DiveSeries::kSingle;
  std::size_t dives = 186;          // kSingle: one round is every perturbation at every level
  std::optional<std::size_t> only;  // this dive alone; its mission is kept
  std::uint64_t seed = 1;
  int jobs = 2;
  std::function<void(std::size_t done, std::size_t total)> progress;
};

struct DiveResult {
  DivePlan plan;
  bool onboard_map = false, topside_map = false;            // features: poses
  double onboard_surface_m = NAN, topside_surface_m = NAN;  // aligned, rms
  double onboard_coverage = NAN, topside_coverage = NAN;
  double onboard_track_m = NAN, topside_track_m = NAN;  // aligned, rms
  double topside_surface_squares =
      NAN;  // mean of squared errors in nav over the variance that the map claims
  double colour_median = NAN, colour_p95 = NAN;  // of topside's mesh (CIEDE2000)
  double nees = NAN, inside = NAN;  // of topside's poses: mean of 6, and share below chi-square's 95 %
  std::size_t false_closures = 0;   // kept in topside's solution
  std::string trouble;              // last output line of each failed program
  double seconds = 0;
};

// What is asked of a dive; of a combined one, of 95 in 100.
struct Requirements {
  double coverage;    // of the undisturbed dive's
  double surface_m;   // topside, aligned rms
  double onboard_m;   // the vehicle's surface
  double colour_p95;  // of topside's mesh
};
[[nodiscard]] Requirements requirementsOf(DiveSeries series);
inline constexpr double kWorstNees = 22.46;  // 99.9 % of chi-square with 6 degrees of freedom

// Requirements that a dive fails, relative to the undisturbed dive of its kind; empty: none.
[[nodiscard]] std::vector<std::string> failedRequirements(const DiveResult& dive,
                                                          const DiveResult& undisturbed);

// Runs the dives that results.jsonl in `out` does not hold yet, appends each result, and writes
// campaign.html. Throws InputError for a folder with other content or another series, and for absent
// programs, scenarios or real seafloors.
std::vector<DiveResult> runCampaign(const CampaignOptions& options);

void writeCampaignPage(const CampaignOptions& options, const std::vector<DiveResult>& dives);

}  // namespace fathom::sim
