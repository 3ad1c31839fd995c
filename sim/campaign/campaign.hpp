#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// Many disturbed dives through the vehicle's program and the one topside: at which level what breaks.
struct CampaignOptions {
  std::filesystem::path out;
  std::filesystem::path programs;   // folder of fathom-onboard and fathom-topside
  std::size_t dives = 144;          // a round has every perturbation at every level once
  std::optional<std::size_t> only;  // this one alone, and its mission stays
  std::uint64_t seed = 1;
  int jobs = 2;
  std::function<void(std::size_t done, std::size_t total)> progress;
};

// What came of one dive. Dives 0 and 1 are undisturbed, with pictures and with features.
struct DiveResult {
  std::size_t dive = 0;
  int perturbation = -1, level = 0;  // -1: undisturbed
  bool pictures = true;
  bool onboard_map = false, topside_map = false;            // features: poses
  double onboard_surface_m = NAN, topside_surface_m = NAN;  // aligned, rms
  double onboard_coverage = NAN, topside_coverage = NAN;
  double onboard_track_m = NAN, topside_track_m = NAN;  // aligned, rms
  double nees = NAN, inside = NAN;  // of topside's poses: mean of 6, and share below chi-square's 95 %
  std::size_t false_closures = 0;   // that stay, topside
  std::string trouble;              // of a program that failed, its last line
  double seconds = 0;
};

// Scenario of a dive; the same for the same seed and dive.
[[nodiscard]] Scenario diveScenario(const CampaignOptions& options, std::size_t dive);
[[nodiscard]] DiveResult planOf(std::size_t dive);

// What is broken in a dive against the undisturbed one of its kind; empty: nothing.
[[nodiscard]] std::vector<std::string> broken(const DiveResult& dive, const DiveResult& undisturbed);

// Dives what results.jsonl in `out` does not hold yet, adds each as it ends, and writes campaign.html. Throws
// InputError for a folder that is no campaign's and for programs that are absent.
std::vector<DiveResult> runCampaign(const CampaignOptions& options);

void writeCampaignPage(const std::filesystem::path& file, const std::vector<DiveResult>& dives,
                       std::uint64_t seed);

}  // namespace fathom::sim
