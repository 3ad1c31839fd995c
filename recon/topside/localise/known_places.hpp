#pragma once

#include <optional>
#include <span>
#include <vector>

#include "recon/import/navigation/nav_data.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::topside {

// What files of navigation know of frames that images alone have put in order. Frames are counted from 0.
class KnownPlaces {
 public:
  // `known`, `ground` (the seafloor's normal in the camera, away from it): by frame. Attitudes by which
  // nearly all of the seafloor would be a steep slope belong to a camera that does not look down: without
  // `mounted`, that somebody said how it looks, they are not used.
  KnownPlaces(std::vector<KnownPose> known, std::vector<Eigen::Vector3d> ground, const SE3& T_body_cam,
              bool mounted);

  [[nodiscard]] bool any() const { return any_; }
  // Of the seafloor against the attitudes that were therefore left out [rad].
  [[nodiscard]] std::optional<double> refusedTilt() const { return refused_tilt_; }

  // The rigid motion by which a part is where navigation has it. Down: by attitudes, else by the seafloor.
  // North: by headings, else by positions that span more than they may be wrong, else the top of the part's
  // first image. Depth: as measured, else 0 of the first camera. `placed`: positions say where.
  struct Motion {
    SE3 T_nav_part;
    bool placed = false;
  };
  [[nodiscard]] Motion motionOf(std::span<const std::uint32_t> part, std::span<const SE3> poses) const;

  // Maximum likelihood of the graph's edges together with what is known; positions that contradict the rest,
  // as a USBL's outliers do, are left out. `graph.poses`: T_nav_cam by frame, parts moved as above. `firsts`:
  // of the parts. The graph that was solved: pose 0 is nav itself, frames follow; the edges come first.
  struct Placed {
    slam::PoseGraph graph;
    bool converged = true;
  };
  [[nodiscard]] Placed improved(const slam::PoseGraph& graph, std::span<const std::uint32_t> firsts);
  [[nodiscard]] std::size_t positionsKept() const { return kept_; }
  [[nodiscard]] std::size_t positionsLeftOut() const { return left_out_; }

  // A step from the frame before by velocities and attitudes; none where these are not known.
  [[nodiscard]] std::optional<slam::NavigationLink> stepTo(std::uint32_t frame) const;
  // What positions say of the distance of two frames, from above: the least and what it may be wrong by [m].
  struct Apart {
    double distance = 0, sigma = 0;
  };
  [[nodiscard]] std::optional<Apart> apart(std::uint32_t a, std::uint32_t b) const;

 private:
  [[nodiscard]] Eigen::Vector3d downInCamera(std::uint32_t frame) const;
  [[nodiscard]] slam::RelativePose measured(std::uint32_t frame, const SE3& T_nav_cam, bool position) const;

  std::vector<KnownPose> known_;
  std::vector<Eigen::Vector3d> ground_;
  SE3 T_body_cam_, T_cam_body_;
  bool any_ = false;
  std::optional<double> refused_tilt_;
  std::size_t kept_ = 0, left_out_ = 0;
};

}  // namespace fathom::topside
