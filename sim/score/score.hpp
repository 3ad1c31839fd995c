#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/se3.hpp"
#include "sim/score/colour_score.hpp"

namespace fathom::sim {

// Errors of estimated camera positions against the truth, over the images of the survey.
struct TrajectoryScore {
  double rms_m = 0;                       // in nav, three-dimensional
  std::optional<double> aligned_rms_m;    // after the best rigid motion of the whole (Umeyama 1991, no scale)
  std::optional<double> crossover_rms_m;  // of relative positions between passes; absent without crossovers
  // Angles between estimated and true axes: of the vertical, and about it [rad].
  std::optional<double> tilt_rms_rad, heading_rms_rad;
  // Normalised estimation error squared (6 degrees of freedom) by the poses' stated covariances: mean, and
  // fraction below chi-square's 95 % quantile. Absent without covariances.
  std::optional<double> nees, inside;
  std::size_t poses = 0;
};

// Errors of an estimated surface: distances from points spread evenly over its area to the true surface.
struct SurfaceScore {
  double rms_m = 0, p50_m = 0, p95_m = 0, p99_m = 0;  // in nav
  double bias_m = 0;  // mean signed distance: positive where the estimate is above the truth
  // Mean of the squared distance in nav over the estimate's own variance there; absent without sigmas.
  std::optional<double> squared_over_variance;
  // After the best rigid motion of the whole (point-to-plane ICP): T_truth_estimate.
  SE3 alignment;
  double aligned_rms_m = 0, aligned_bias_m = 0, aligned_p95_m = 0;
  double coverage = 0;  // fraction of the seen seafloor in plan that the aligned estimate covers
  // Fraction of the seen true points with the aligned estimate within kComplete.
  double completeness = 0;
  static constexpr double kComplete = 0.033;  // the default voxel [m]
};

struct ScoreReport {
  std::vector<std::pair<std::string, ColourScore>> colours;  // of each product with colours
  std::optional<TrajectoryScore> dead_reckoning, onboard, topside;
  std::optional<SurfaceScore> onboard_surface, topside_surface;
  std::vector<std::pair<std::string, SurfaceScore>> surfaces;  // of further files, by their names
  std::vector<std::string> notes;                              // missing parts and the reasons
};

// Compares <mission>/onboard and <mission>/topside, and `surfaces` (PLY meshes in nav, such as one level of
// the model), with <mission>/truth. Missing files are noted and left out. The result is deterministic. Throws
// InputError for a mission without truth, for damaged files and for surfaces without triangles.
[[nodiscard]] ScoreReport scoreMission(const std::filesystem::path& mission,
                                       const std::vector<std::filesystem::path>& surfaces = {});

// {"trajectory":{"dead_reckoning":{"rms_m":...},"onboard":{...},"topside":{...}},
//  "surface":{"onboard":{...},"topside":{...},"files":{"<name>":{...}}},
//  "colour":{"onboard":{"median":...},"mesh":{...},"orthomosaic":{...}}}; parts that are missing are null.
[[nodiscard]] std::string scoreJson(const ScoreReport& report);
[[nodiscard]] std::string scoreTable(const ScoreReport& report);

}  // namespace fathom::sim
