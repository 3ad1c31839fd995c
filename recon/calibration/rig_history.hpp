#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// Relative error of a rig's ranges, as a logarithm, positive where they are too long: scale + per_metre *
// range. A wrong baseline causes the first; a turn towards the other camera, and principal points, the
// second.
struct RangeError {
  double scale = 0;      // [1]
  double per_metre = 0;  // [1/m]
  [[nodiscard]] double at(double range) const { return scale + per_metre * range; }
};

// Growth of ranges when the same matches are triangulated by `to` instead of `from`: in the middle of the
// image, at ranges of a survey.
[[nodiscard]] RangeError rangeChange(const StereoRig& from, const StereoRig& to);
// The rig with its baseline and its right principal point changed so that its ranges are free of `error`.
[[nodiscard]] StereoRig withoutRangeError(const StereoRig& rig, const RangeError& error);

// Triangulates the pixels of `point`, a point by `from`, by `to`: left camera frame [m]. `point` itself where
// the rays do not meet.
[[nodiscard]] Eigen::Vector3d retriangulated(const StereoRig& from, const StereoRig& to,
                                             const Eigen::Vector3d& point);
// The same for all vertices of a mesh, with their standard deviations along z.
void retriangulate(const StereoRig& from, const StereoRig& to, Mesh& mesh);

// Versions of the estimated rig, so that points triangulated by an earlier version can be triangulated again.
// Fixed memory.
class RigHistory {
 public:
  static constexpr std::size_t kMost = 64;

  explicit RigHistory(const StereoRig& rig);

  // Factor on the threshold of a change of the same rig, relative to the first: it doubles every few
  // versions.
  [[nodiscard]] double worth() const;
  [[nodiscard]] bool full() const { return versions_.size() == kMost; }
  // Adds the rig from now on; `same`: the rig did not change, its estimate did. No effect when full.
  void add(const StereoRig& rig, bool same);

  [[nodiscard]] int newest() const { return static_cast<int>(versions_.size()) - 1; }
  [[nodiscard]] const StereoRig& rig(int version) const {
    return versions_[static_cast<std::size_t>(version)].rig;
  }
  // The newest version without a knock since `version`: the best estimate of the rig at that time.
  [[nodiscard]] int best(int version) const;

  // For saved state; of a rig with the same calibration.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.bounded(self.versions_, kMost);
    archive.require(!self.versions_.empty(), "a rig without versions");
    if constexpr (Archive::kLoading) self.restore();
  }

 private:
  struct Version {
    StereoRig rig;
    int knocks = 0;  // before this version

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.rig.T_right_left, self.rig.left.fx, self.rig.left.fy, self.rig.right.fx, self.rig.right.fy,
              self.rig.right.cx, self.knocks);
    }
  };
  void restore();

  StereoRig calibrated_;
  std::vector<Version> versions_;
};

}  // namespace fathom::calibration
