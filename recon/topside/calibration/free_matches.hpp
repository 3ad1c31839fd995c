#pragma once

#include <optional>
#include <vector>

#include "recon/calibration/self_calibration.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/import/images/board_images.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {

// Matches for judging a rig. The stereo stage looks along epipolar lines, so what it finds is on them
// whatever the calibration; here Lucas-Kanade (cv::calcOpticalFlowPyrLK) goes wherever the image leads it,
// from where the seafloor's plane says, forth and back. Images: 8 bit mono, of the rig's size.
[[nodiscard]] std::vector<RigMatch> matchFreely(const StereoRig& rig, const ImageView& left,
                                                const ImageView& right, const stereo::SeedPlane& plane);

// Points seen by stereo, in the left camera frame [m].
struct SeenPoint {
  Eigen::Vector2d left;
  Eigen::Vector3d point;
};
// Triangulates the matches that are near the median epipolar error of the pair and within the ranges.
[[nodiscard]] std::vector<SeenPoint> triangulate(const StereoRig& rig, const std::vector<RigMatch>& matches,
                                                 double min_range, double max_range);

// The camera's motion from one left image to the next, from points tracked into it (perspective pose with
// RANSAC); starts from `T_c1_c0`. std::nullopt when too few points agree.
struct SeenMotion {
  Eigen::Quaterniond R_c1_c0;
  Eigen::Vector3d middle0, middle1;
  std::size_t points = 0;
};
[[nodiscard]] std::optional<SeenMotion> trackMotion(const Camera& camera, const ImageView& first,
                                                    const ImageView& next,
                                                    const std::vector<SeenPoint>& points, const SE3& T_c1_c0);

// What the pairs show in common: SIFT (Lowe 2004), matched between left and right
// of a pair and from pair to pair (the next three), each the other's best and clearly better
// than the second. Pairs in the order of findStereoFiles(); of more than `most`, a run of that many in the
// middle of the track. Images are read in parallel, with progress on stderr. Throws InputError, which names
// the file, for one that cannot be read or has another size than the first.
[[nodiscard]] calibration::RigTracks findTracks(const BoardImageOptions& options, std::size_t most);

}  // namespace fathom::topside
