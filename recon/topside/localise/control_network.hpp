#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/control_points.hpp"
#include "recon/solver/pose_graph.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// What control points, check points and scale bars say of a dive.
struct ControlResult {
  struct Point {
    std::string name;
    bool surveyed = false, check = false;
    bool left_out = false;  // its survey contradicts the others
    std::uint32_t marks = 0, marks_left_out = 0;
    Eigen::Vector3d place = Eigen::Vector3d::Zero();  // as the images have it, in nav [m]
    // Of that, as the network claims it, and with the survey's own; less where the survey has it [m].
    Eigen::Vector3d sigma = Eigen::Vector3d::Zero(), off = Eigen::Vector3d::Zero();
    double pixel_rms = 0;  // of its marks that count, a coordinate [px]

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.name, self.surveyed, self.check, self.left_out, self.marks, self.marks_left_out,
              self.place, self.sigma, self.off, self.pixel_rms);
    }
  };
  struct Bar {
    std::string from, to;
    bool check = false;
    double length = 0, sigma = 0, off = 0;  // as surveyed; as the images have it less that [m]

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.from, self.to, self.check, self.length, self.sigma, self.off);
    }
  };
  std::vector<Point> points;
  std::vector<Bar> bars;
  bool scaled = false;                // they tell a scale
  double scale = 1, scale_sigma = 0;  // by which ranges and paths of the images had to be multiplied
  bool converged = true;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.points, self.bars, self.scaled, self.scale, self.scale_sigma, self.converged);
  }
};

// The rig, and a pose, by which all is so many times as large.
[[nodiscard]] StereoRig grown(const StereoRig& rig, double scale);
[[nodiscard]] inline SE3 grown(const SE3& T, double scale) {
  return {T.rotation(), scale * T.translation()};
}

// Marked points as poses of a network: each mark is the place of its point in a camera, sure across the ray,
// and along it as features about the mark have the range; a survey is its place in nav. Points that nobody
// surveyed, and check points, only follow.
class ControlNetwork {
 public:
  // All but the sightings must outlive it.
  ControlNetwork(const ControlPoints& control, std::span<const ControlSighting> sightings,
                 const StereoRig& rig, const Frames& frames);

  // The scale by which parts must grow so that distances of points are as surveyed, at these poses: the
  // median of the longer ones. 1: nobody surveyed two of a part.
  [[nodiscard]] double scaleAt(std::span<const std::vector<std::uint32_t>> parts,
                               std::span<const SE3> poses) const;
  // The rigid motion in nav that brings a part's points nearest to where they were surveyed: of three and
  // more, in any direction, as most of them agree; of two, about the vertical, where `turns`; else a shift.
  // None: no such point.
  [[nodiscard]] std::optional<SE3> motionOf(std::span<const std::uint32_t> part, std::span<const SE3> poses,
                                            bool turns) const;

  // A solved network in nav: its frames, nav's origin (a pose that is held), and the edges that images
  // measured, which share an error of scale of that standard deviation.
  struct Solved {
    slam::PoseGraph* graph = nullptr;
    std::vector<int> nodes;
    int origin = 0;
    std::vector<std::size_t> visual;
    double scale_sigma = 0;
    double scale = 1;  // to begin with; poses have it
  };
  // The most likely poses and scale of the network with control points and bars (points are appended, as
  // poses, and edges; visual ones are scaled). Weights in it stay; marks and surveys that contradict are left
  // out.
  ControlResult adjust(Solved& network);

 private:
  struct Mark {
    ControlSighting seen;
    std::uint32_t frame = 0;
    Eigen::Vector3d place;       // in the left camera [m]
    Eigen::Matrix3d covariance;  // of that [m^2]
    bool used = true;
  };
  struct State;
  [[nodiscard]] std::optional<Mark> markOf(const ControlSighting& sighting, std::uint32_t frame) const;
  // Whether the survey of a point has a part in the result.
  [[nodiscard]] bool holds(std::uint32_t point) const;
  // Of each point that frames `of` have marked: where the marks have it, at these poses.
  [[nodiscard]] std::vector<std::optional<Eigen::Vector3d>> placesAt(std::span<const SE3> poses,
                                                                     const std::vector<bool>& of) const;
  [[nodiscard]] bool tellsScale() const;
  void append(const Solved& network, double scale, slam::PoseGraph& graph) const;
  [[nodiscard]] State solved(const Solved& network, double scale, const std::vector<SE3>& start) const;
  [[nodiscard]] bool leaveOut(const Solved& network, const State& state);
  // What points and bars came to in the adjusted network; `by_scale`: how places move with the scale.
  void report(const Solved& network, const std::vector<Eigen::Vector3d>& by_scale, ControlResult& out);

  const ControlPoints& control_;
  const StereoRig& rig_;
  const Frames& frames_;
  std::vector<Mark> marks_;
  std::vector<bool> left_out_;  // of each point: its survey contradicts the others
  double looser_ = 1;           // so many times are surveys' standard deviations taken
};

}  // namespace fathom::topside
