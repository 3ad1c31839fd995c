#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/light/lighting_stage.hpp"

namespace fathom::topside {

// How the rig stands in this dive against how it was calibrated, by matches that are found without its help.
// A tenth of a degree puts every match off its epipolar line, and stereo finds nothing.
struct RigFinding {
  std::uint64_t matches = 0;
  double before = 0,
         after = 0;  // worst part of the image, and of one match when what is below is taken out [px]
  bool moved = false;
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  // of the right camera about its x, y, z [rad]
  double focal = 0;                                    // right over left, logarithm

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.matches, self.before, self.after, self.moved, self.rotation, self.focal);
  }
};

// Of up to kRigPairs pairs, spread over the dive, that stand over known ground; where the rig has moved, of
// more: the turn towards the left camera, which makes all ranges wrong, shows least.
inline constexpr std::size_t kRigPairs = 12, kMovedRigPairs = 120;
[[nodiscard]] RigFinding findRig(const MissionInput& input, const Survey& survey,
                                 const LightingModels& models);
// As it stands in this dive.
[[nodiscard]] StereoRig rigAsFound(const StereoRig& rig, const RigFinding& found);
// For who reads the report; none where the rig stands as it was calibrated.
[[nodiscard]] std::optional<std::string> warningOf(const RigFinding& found);

}  // namespace fathom::topside
