#pragma once

#include <cstdint>
#include <optional>

#include "realtime/onboard/localisation/localisation_config.hpp"
#include "recon/closure/candidates.hpp"

namespace fathom::onboard {

// The last frame that became one. Outside the class, where a complete one can be made inside std::optional.
struct LastKeyframe {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  closure::Footprint seen;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.utc_ns, self.T_odom_cam, self.seen.centre, self.seen.radius);
  }
};

// Which stereo frames become keyframes: those that share less than a given part of their footprint with the
// last one, turned, or come late.
class KeyframeSelection {
 public:
  explicit KeyframeSelection(const LocalisationConfig& config) : config_(config) {}

  // What a pose may still be corrected by.
  struct Slack {
    double metres = 0, radians = 0;
  };
  // Whether the frame becomes one if it is taken now, or would if its pose were corrected by so little.
  [[nodiscard]] bool due(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                         bool trusted, const Slack& slack = {0, 0}) const;
  // Whether the frame at `T_odom_cam` becomes one; it then is the last. `seen`: its footprint in odom.
  // `trusted`: odometry can tell how far the vehicle went; if not (no bottom track, a DVL that lies), every
  // frame is taken, so that the images can tell.
  bool take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen, bool trusted = true);

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.last_);
  }

 private:
  LocalisationConfig config_;
  std::optional<LastKeyframe> last_;
};

}  // namespace fathom::onboard
