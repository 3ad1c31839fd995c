#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "telemetry/web/report_fields.hpp"

namespace fathom::topside {

// How poses with covariances compare with a simulated mission's truth.
struct Consistency {
  struct Moment {
    double time_s = 0;                           // since the first pair
    Eigen::Vector3d position, turn;              // estimate less truth in nav axes [m], [rad]
    Eigen::Vector3d sigma_position, sigma_turn;  // as claimed
    double squared = 0;      // error over covariance, 6 degrees of freedom (NEES); of the place in nav
    double since_first = 0;  // the same of the pose as seen from the first pair's
  };
  std::vector<Moment> moments;
  double mean_squared = 0, mean_since_first = 0;
  double share_inside = 0;  // of moments below chi-square's 95 %
  // Closures that are off by more than kFalsePosition or kFalseTurn; and how many pairs whose footprints
  // share more than kOverlap of their area, not linked by odometry anyway, there are, were tried and were
  // accepted.
  static constexpr double kFalsePosition = 0.1, kFalseTurn = 0.05;  // [m], [rad]
  static constexpr double kOverlap = 0.3;
  double mean_squared_odometry = 0, mean_squared_closures = 0;  // of links, against their own covariance
  std::size_t false_closures = 0, false_closures_kept = 0;
  std::size_t overlapping = 0, overlapping_tried = 0, overlapping_accepted = 0;
};

// Empty when the mission has no truth/trajectory.csv. Poses are compared at the true times of exposure where
// truth/images.csv tells them.
[[nodiscard]] Consistency compareWithTruth(const std::filesystem::path& mission, const SE3& T_body_cam,
                                           const Camera& camera, const PairList& list,
                                           const SlamResult& slam);

// The figures of localisation, as report.json and slam.json and their pages have them, with standard
// deviations of what the images say of extrinsics, clocks and the USBL; and how it compares with a truth.
[[nodiscard]] web::Fields slamFields(const SlamResult& slam);
[[nodiscard]] web::Fields truthFields(const Consistency& consistency);
// What whoever uses the poses must know, a sentence each: no convergence, crossings that were not verified,
// extrinsics or clocks that cannot be right.
[[nodiscard]] std::vector<std::string> slamWarnings(const SlamResult& slam);
// The parts that nothing joins, a section of the page; nothing where there is one.
void addParts(web::ReportPage& report, const std::vector<SlamResult::Part>& parts,
              const std::vector<ImagePair>& pairs);

// slam.json, and slam.html: both tracks from above with the closures (after figure 9 of Johnson-Roberson et
// al. 2010), how far closures disagree with dead reckoning and with the solved poses (their figure 10),
// counts, what was found of the sensors; and against a simulated mission's truth, errors beside the standard
// deviations claimed.
void writeSlamReport(const std::filesystem::path& folder, const SlamResult& slam,
                     const Navigation& navigation, const SE3& T_body_cam, bool features_only,
                     const Consistency& truth);

}  // namespace fathom::topside
