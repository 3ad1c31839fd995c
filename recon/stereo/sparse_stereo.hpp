#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "realtime/base/config_keys.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::stereo {

struct Kernels;

struct SparseStereoConfig {
  int max_features = 800;                // wanted Harris corners, spread over the image (up to 5000)
  int window = 15;                       // Lucas-Kanade window edge [px], odd
  double max_epipolar_distance = 1.0;    // [px]
  double max_left_right_distance = 0.5;  // left-right check [px]
  // Between the positions that the whole window and its middle half converge to [px]: across a step in depth
  // the window follows the side with more contrast, its middle the side of the point.
  double max_core_distance = 0.4;
  double sigma_scale = 1.0;                  // of all standard deviations; 1 is calibrated
  double max_edge = 0.5;                     // longest triangle edge [m]
  double min_range = 0.5, max_range = 12.0;  // accepted z [m]
  double search_radius = 32.0;   // reach of the search along the epipolar line about the seed [px]
  double min_correlation = 0.6;  // zero-mean normalised, of the two windows
  double max_slope = 1.396;      // between a triangle's normal and the line of sight [rad]: 80 deg; a steeper
                                 // triangle spans a gap between surfaces
  int min_patch_points = 6;      // smaller isolated groups of points are dropped
  bool look_again = false;       // with four times the corners, at a pair that gives too few points
  double max_fish_length = 0.6;  // longest object in mid-water that is dropped as a fish [m]; 0: none
};

// The seafloor as a plane in the left camera frame, from DVL altitude and attitude: normal . p = distance.
struct SeedPlane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double distance = 2.0;  // [m]

  // Range along the principal ray to the plane [m]; that of 78 degrees off it where it is more.
  [[nodiscard]] double ahead() const { return distance / std::max(normal.z(), 0.2); }
};

struct StereoPoint {
  Eigen::Vector2f left;  // distorted pixel
  Eigen::Vector2f right;
  Eigen::Vector3f point;                 // left camera frame [m]
  float sigma_z = 0;                     // standard deviation of z [m]
  std::array<float, 6> covariance = {};  // of the point: xx, xy, xz, yy, yz, zz [m^2]; zz = sigma_z^2
};

struct StereoResult {
  std::vector<RigMatch> matches;  // before the check by the epipolar line
  std::vector<StereoPoint> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // of points; normals towards the camera
  struct Rejected {
    // No match found, or another position with the window's middle alone, or hidden by a mask.
    std::uint32_t no_track = 0;
    std::uint32_t left_right = 0, epipolar = 0, range = 0;
    std::uint32_t outlier = 0;  // depth contradicts the neighbours'
    std::uint32_t fish = 0;     // on an object in mid-water
  } rejected;
  std::uint32_t corners = 0;
  float noise_scale = 1;  // by which MatchNoise inflated the standard deviations
};

// Sparse stereo for a small-baseline down-looking rig, on distorted images, after Johnson-Roberson et al.
// 2010, section 4.2:
// 1. Harris corners, spread over what both cameras see of the seed plane (HarrisCorners).
// 2. Each is searched along its epipolar line about the seed plane and refined down a pyramid by Lucas-Kanade
//    with gain and offset (EpipolarSearch, PatchTracker). The window's middle must converge to the same
//    position.
// 3. The match must be near the epipolar line (calibration), and the same search from it in the left image
//    must end at the corner.
// 4. Midpoint triangulation with a covariance: the match's own, J S J^T through the triangulation
//    (MidpointTriangulation), inflated by the frame's epipolar residuals (MatchNoise). For parallel
//    cameras sigma_z = z^2 sigma_d / (f b), with the sigma_d of that match.
// 5. Mismatches and fish are dropped (DepthConsistency), the rest is triangulated in the image (LocalMesh).
// A pair that gives less than a quarter of the wanted points is looked at again at half and then at a quarter
// of its size, between all configured ranges: the ground is blurred, fainter than the noise of single pixels,
// or not where the altitude says. With look_again, one that gives less than three quarters of them is looked
// at again with four times the corners, in these looks too: where contrast is low most match no other, and
// those next in strength are as good.
// The look with most points counts.
//
// Work. The images cost the same in every frame: pyramids and corners, some 3 ms for a full-size pair. A
// feature costs at most, in each direction, search_radius / 2 + 1 window correlations and 22 Lucas-Kanade
// steps on 3 levels, and 12 more steps for the middle; steps 4 and 5 are linear in the number of features.
// Lower max_features lowers the time of a frame in proportion. A further look costs a feature as much on
// fewer levels, and up to 129 correlations of its search. No call of the heap after construction.
class SparseStereo {
 public:
  // Throws std::invalid_argument for a configuration out of range. `kernels`: the instruction set to use,
  // null for the fastest of this processor; the result is the same in every one.
  SparseStereo(const StereoRig& rig, const SparseStereoConfig& config, const Kernels* kernels = nullptr);
  ~SparseStereo();

  // `left`, `right`: 8-bit mono, the rig's size; hidden parts of their masks give no points. `max_features`:
  // this frame's quota of corners, up to the configured number; <= 0: as configured. The result is reused by
  // the next call. Empty or wrongly sized images give an empty result.
  const StereoResult& process(const ImageView& left, const ImageView& right, const SeedPlane& plane,
                              int max_features = 0);

  // Changes the rig; image sizes stay. No call of the heap.
  void setRig(const StereoRig& rig);

  // Called with the stage's name at the end of each stage of process(): "pyramids", "corners", "tracking",
  // "outliers", "triangles". For a caller that has a clock; empty: none.
  void setStageObserver(std::function<void(const char* stage)> observer);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The local mesh of a stereo result in the left camera frame, with sigma and colours sampled from `left_rgb`
// (8-bit RGB or mono, same size as the left image; empty: no colours).
[[nodiscard]] Mesh toMesh(const StereoResult& result, const ImageView& left_rgb);
// The same into a mesh that keeps its memory.
void toMesh(const StereoResult& result, const ImageView& left_rgb, Mesh& mesh);

// The keys of a [stereo] table.
void visitSparseStereo(KeyVisitor& keys, SparseStereoConfig& config);

}  // namespace fathom::stereo
