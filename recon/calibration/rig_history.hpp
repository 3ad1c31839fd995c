#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::calibration {

// By how much a rig's ranges are too long, as a logarithm: scale + per_metre * range. A baseline that is
// wrong gives the first; a turn towards the other camera, and principal points, the second.
struct RangeError {
  double scale = 0;      // [1]
  double per_metre = 0;  // [1/m]
  [[nodiscard]] double at(double range) const { return scale + per_metre * range; }
};

// By how much ranges grow when the same matches are seen through `to` instead of `from`: in the middle of the
// image, at ranges of a survey.
[[nodiscard]] RangeError rangeChange(const StereoRig& from, const StereoRig& to);
// The rig with its baseline and its right principal point changed so that ranges which were too long by
// `error` are right.
[[nodiscard]] StereoRig withoutRangeError(const StereoRig& rig, const RangeError& error);

// Where the pixels that meet at `point` through `from` meet through `to`, left camera frame [m]; `point`
// itself where they do not.
[[nodiscard]] Eigen::Vector3d seenThrough(const StereoRig& from, const StereoRig& to,
                                          const Eigen::Vector3d& point);
// All vertices of a mesh in the left camera's frame, with their standard deviations along z.
void seeThrough(const StereoRig& from, const StereoRig& to, Mesh& mesh);

// The rig as it was taken to stand, version after version, so that what was triangulated earlier can be
// triangulated anew. Fixed memory.
class RigHistory {
 public:
  static constexpr std::size_t kMost = 64;

  explicit RigHistory(const StereoRig& rig);

  // By how much larger than at first a change of the same rig should be to be worth a version.
  [[nodiscard]] double worth() const;
  [[nodiscard]] bool full() const { return versions_.size() == kMost; }
  // As it is taken to stand from now on; `same`: it stood so before too, and is known better now. Not when
  // full.
  void add(const StereoRig& rig, bool same);

  [[nodiscard]] int newest() const { return static_cast<int>(versions_.size()) - 1; }
  [[nodiscard]] const StereoRig& rig(int version) const {
    return versions_[static_cast<std::size_t>(version)].rig;
  }
  // The version that tells best how the rig stood while it was taken for `version`.
  [[nodiscard]] int best(int version) const;

  // For saved state; of the same rig as it was calibrated.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.bounded(self.versions_, kMost);
    archive.require(!self.versions_.empty(), "a rig without versions");
    if constexpr (Archive::kLoading) self.restore();
  }

 private:
  struct Version {
    StereoRig rig;
    int knocks = 0;  // before it

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
