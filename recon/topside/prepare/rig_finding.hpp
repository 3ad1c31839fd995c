#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/calibration/rig_history.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/navigation/sensors/dvl_calibration.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// How the rig stands in this dive against how it was calibrated: its turn, focal lengths and
// distortion by matches that are found without its help, as far from their epipolar lines as they are; what
// these do not show, a baseline or principal points that are wrong, by paths between pairs as visual odometry
// and the DVL measure them, weighed by what is known of both beforehand (slam::DvlCalibration), or as far as
// the DVL's altitudes say so too.
struct RigFinding {
  std::uint64_t matches = 0;
  double before = 0,
         after = 0;  // worst part of the image, and of one match when what is below is taken out [px]
  bool moved = false;
  calibration::RigChange change;
  double yaw_sigma = 0;           // of change.rotation.y [rad]
  std::uint64_t steps = 0;        // paths that both measured
  calibration::RangeError range;  // of the rig changed so
  double usual_range = 0;         // median of the dive [m]
  double range_sigma = 0;         // of the range error there [1]

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.matches, self.before, self.after, self.moved, self.change, self.yaw_sigma, self.steps,
            self.range.scale, self.range.per_metre, self.usual_range, self.range_sigma);
  }
};

// Of up to kRigPairs pairs, spread over the dive, that stand over known ground; where the rig has moved, of
// more: the turn towards the left camera, which makes all ranges wrong, shows least. And of so many paths,
// one in kRigShare of a long dive's, as an error of scale moves its ends farther.
inline constexpr std::size_t kRigPairs = 40, kMovedRigPairs = 120, kLeastRigSteps = 160, kMostRigSteps = 800,
                             kRigShare = 5;
[[nodiscard]] RigFinding findRig(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                                 const LightingModels& models);
// Of a step: logarithms of the camera's over the DVL's, of how far and of how high above the seafloor.
struct CameraOverDvl {
  double path = NAN, altitude = NAN;  // not finite: unknown
};
// Which steps the DVL measured over the seafloor. A rig makes paths and ranges too long alike, and all of
// them, but for relief; over a layer in the water that the DVL took for the seafloor its altitude fits no
// path, or, as the layer drifts, a path and not the other altitudes.
[[nodiscard]] std::vector<bool> areOfSeafloor(std::span<const CameraOverDvl> steps);
// As it stands in this dive.
[[nodiscard]] StereoRig rigAsFound(const StereoRig& rig, const RigFinding& found);
// What is then still open of it.
[[nodiscard]] slam::RigPrior rigPrior(const StereoRig& rig, const RigFinding& found);
// For readers of the report; none where the rig stands as it was calibrated.
[[nodiscard]] std::optional<std::string> warningOf(const RigFinding& found);

}  // namespace fathom::topside
