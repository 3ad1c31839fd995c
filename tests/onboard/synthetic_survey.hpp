#pragma once

#include "realtime/onboard/localisation/localisation_core.hpp"
#include "realtime/onboard/slots/slot_store.hpp"
#include "recon/calibration/rig_history.hpp"

namespace fathom::onboard::testing {

// Slots in memory; on request it fails as a bad disk does.
class MemorySlots : public SlotStore {
 public:
  MemorySlots(std::size_t slots, std::size_t bytes) : bytes_(bytes), blocks_(slots) {}
  [[nodiscard]] std::size_t slots() const override { return blocks_.size(); }
  [[nodiscard]] std::size_t slotBytes() const override { return bytes_; }
  [[nodiscard]] bool write(std::size_t slot, std::span<const std::uint8_t> data) override;
  [[nodiscard]] bool read(std::size_t slot, std::span<std::uint8_t> data) override;

  bool fails = false;

 private:
  std::size_t bytes_;
  std::vector<std::vector<std::uint8_t>> blocks_;
};

struct DiveFaults {
  double dvl_dead_from = 1e9, dvl_dead_to = 1e9;    // [s]; dead reckoning stands still and says so
  double dvl_wrong_from = 1e9, dvl_wrong_to = 1e9;  // [s]; 0.25 m/s to starboard, and says nothing
  double dvl_stuck_from = 1e9, dvl_stuck_to = 1e9;  // [s]; half the velocity, and says nothing
  double compass_jumps_at = 1e9;            // by 20 degrees, reported as a leap and left in the odometry [s]
  double compass_steps_at = 1e9;            // by 7 degrees, and says nothing [s]
  double blind_from = 1e9, blind_to = 1e9;  // [s]; no features
  double wild_share = 0;                    // of the fixes, 40 m off
  // Seconds in which dead reckoning goes astray by 10 m to the east, without bottom track, and its heading by
  // 100 degrees in the end, reported as a leap.
  double astray_from = 1e9, astray_to = 1e9;
};

// Track of a dive. Crossing: a line of 8 m to the north, then far out, and back across the line's middle at
// right angles, 38 s later. Elsewhere: the same, but the return track is over other ground with points that
// look like those of the line at other positions.
enum class DiveTrack { kLawnMower, kCrossing, kElsewhere };

// A short lawn-mower dive at 2 m over a seafloor of points with descriptors, and what dead reckoning makes of
// it: a compass with a deviation, a DVL with a scale error; fixes of 0.5 m every 5 s.
struct SyntheticSurvey {
  struct Frame {
    std::int64_t utc_ns = 0;
    SE3 truth;  // T_nav_cam
    LocalisationInput input;
    closure::FrameFeatures features;
    // Gives it to a localisation; the keyframe that it hangs on then.
    int placeIn(LocalisationCore& core) const {
      LocalisationInput seen = input;
      seen.features = &features;
      return core.place(seen, core.look(seen));
    }
  };
  struct Fix {
    std::int64_t utc_ns = 0, arrival_ns = 0;
    Eigen::Vector3d in_odom;
    Eigen::Vector2d north_east;
    void addTo(LocalisationCore& core) const {
      core.addFix(nav::FixKind::kUsbl, utc_ns, in_odom, north_east, 0.5);
    }
  };
  StereoRig rig;
  calibration::RigHistory rigs{StereoRig{}};  // of it alone
  std::vector<Frame> frames;
  std::vector<Fix> fixes;
};

[[nodiscard]] SyntheticSurvey syntheticSurvey(const DiveFaults& faults = {}, std::uint32_t seed = 1,
                                              DiveTrack track = DiveTrack::kLawnMower);

// Drives a dive through a localisation; the final poses of the frames.
[[nodiscard]] std::vector<SE3> localised(LocalisationCore& core, const SyntheticSurvey& dive);

// Largest and RMS distance in plan after the best shift and turn [m].
struct PlanError {
  double rms = 0, absolute = 0;
};
[[nodiscard]] PlanError planError(const SyntheticSurvey& dive, const std::vector<SE3>& poses);

[[nodiscard]] LocalisationConfig smallLocalisation();
// For the features of so many keyframes.
[[nodiscard]] MemorySlots featureSlots(std::size_t slots,
                                       const LocalisationConfig& config = smallLocalisation());

}  // namespace fathom::onboard::testing
