#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/pieces/fused_pair.hpp"

namespace fathom::topside {

// Of a pose in nav, as a map with north up has it: (east, north) [m].
[[nodiscard]] Eigen::Vector2d eastNorth(const SE3& T_nav);

// stereo_pose_est.data and vehicle_pose_est.data.
void writePoses(const std::filesystem::path& folder, const Geodetic& origin,
                const std::vector<FusedPair>& pairs);

// pose_covariances.csv: of pairs spread over the dive, 2,000 at most.
void writePoseCovariances(const std::filesystem::path& folder, const std::vector<ImagePair>& pairs,
                          const SlamResult& slam);

// closures.csv: which pairs, their relative pose (deviations of its right perturbation), and whether it was
// kept.
void writeClosures(const std::filesystem::path& path, const std::vector<ImagePair>& pairs,
                   const std::vector<slam::NavigationLink>& closures);

// How far closures disagree with poses: distance between where a closure has the second camera, seen from the
// first, and where the poses have it [m]; one number a kept closure.
[[nodiscard]] std::vector<double> closureErrors(const std::vector<slam::NavigationLink>& closures,
                                                const std::vector<NavigatedPose>& poses,
                                                const SE3& T_body_cam);

// For each pair, whether its footprint overlaps one taken more than a minute earlier or later: the vehicle
// came back.
[[nodiscard]] std::vector<bool> likelyCrossovers(const std::vector<FusedPair>& pairs);

}  // namespace fathom::topside
