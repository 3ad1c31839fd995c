#pragma once

#include <cstdint>
#include <optional>

#include "realtime/onboard/localisation/localisation_config.hpp"
#include "recon/closure/candidates.hpp"

namespace fathom::onboard {

// The last frame that became a keyframe. Outside the class, so that std::optional can hold a complete type.
struct LastKeyframe {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  closure::Footprint seen;

  static void exchange(auto& archive, auto& self) {
    archive(self.utc_ns, self.T_odom_cam, self.seen.centre, self.seen.radius);
  }
};

// Which stereo frames become keyframes: those that share less than a given part of their footprint with the
// last one, turned, or come late.
class KeyframeSelection {
 public:
  explicit KeyframeSelection(const LocalisationConfig& config) : config_(config) {}

  // Possible further correction of a pose.
  struct Slack {
    double metres = 0, radians = 0;
  };
  // Whether the frame becomes one if it is taken now, or would if its pose were corrected by so little.
  [[nodiscard]] bool due(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                         bool reliable, const Slack& slack = {0, 0}) const;
  // Whether the frame at `T_odom_cam` becomes a keyframe; it then is the last. `seen`: its footprint in odom.
  // `reliable`: odometry measures the distance travelled; if not (no bottom track, an outlying DVL), every
  // frame is taken, so that the images can measure it.
  bool take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen, bool reliable = true);

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) { archive(self.last_); }

 private:
  LocalisationConfig config_;
  std::optional<LastKeyframe> last_;
};

}  // namespace fathom::onboard
