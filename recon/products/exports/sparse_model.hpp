#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recon/closure/frame_features.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

// What structure from motion would have made of a dive: where every image was taken, and points with the
// pixels at which they were seen. World: x east, y north, z up [m], of the dive's origin; images have their
// original size and pixels, the centre of the top left one being (0, 0).

// One stereo pair. Both its cameras saw every feature, at the pixels that were measured.
struct StereoView {
  std::string left, right;  // names of the images, relative to the mission's image folder
  SE3 T_world_cam;          // of the left camera
  std::vector<closure::Feature> features;
  std::vector<std::uint32_t> point_of;  // of each feature: its point
};

// A place on the ground, and the features that are it, of different views.
struct SparsePoint {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Rgb colour{128, 128, 128};
  float error = 0;          // mean over all its pixels of the distance to where it projects [px]
  std::uint32_t first = 0;  // of its members in SparseModel
  std::uint32_t views = 0;  // so many members, each seen by both cameras
};

struct SparseModel {
  struct Member {
    std::uint32_t view = 0, feature = 0;
  };
  std::optional<Geodetic> origin;  // none: nobody said where the dive was
  std::string placed_by;           // Anchor::source
  StereoRig rig;
  std::vector<StereoView> views;  // by time
  std::vector<SparsePoint> points;
  std::vector<Member> members;  // of all points; of each by view

  [[nodiscard]] double meanError() const;  // over all pixels [px]
};

// Pixel coordinates of other programs, whose corner pixel is centred on (0.5, 0.5), less ours.
inline constexpr double kHalfPixel = 0.5;

// The rotation from nav to that world.
[[nodiscard]] SE3 worldFromNav();
// Where the world is on the Earth, in words and as a coordinate system, for people.
[[nodiscard]] std::string originText(const SparseModel& model);

// Distance of a feature's pixels, left and right, from where a place projects [px]; infinite behind a camera.
[[nodiscard]] std::array<double, 2> pixelErrors(const StereoRig& rig, const SE3& T_world_cam,
                                                const closure::Feature& feature,
                                                const Eigen::Vector3d& place);

}  // namespace fathom::topside
