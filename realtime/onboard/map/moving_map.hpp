#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "realtime/onboard/slots/slot_store.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::onboard {

// A map whose meshes hang on keyframes that move. Every local mesh is kept in a slot, in its camera's frame.
// When keyframes have moved, a second map is fused from all meshes at their present poses, in their order, a
// few a frame, while the first goes on being shown and takes in what is new; when the second has caught up,
// the two change places. So the map shown is always one that was fused mesh by mesh, and after finish() it is
// exactly the map that is fused afresh from the final poses. (Taking single meshes out of a tile again would
// be less work, but a node's votes and roundings cannot be undone.)
class MovingMap {
 public:
  // Pose of a mesh's camera now.
  using PoseOf = std::function<SE3(int keyframe, const SE3& T_odom_cam)>;
  // A mesh has moved: where it was and where it is, in north and east [m].
  struct Box {
    Eigen::Vector2f low = Eigen::Vector2f::Constant(1), high = Eigen::Vector2f::Constant(-1);  // empty
    [[nodiscard]] bool empty() const { return low.x() > high.x(); }
  };
  using OnMoved = std::function<void(const Box& before, const Box& now)>;

  // `meshes`: null, or without slots, for a map that never moves. It then has a second map to build in.
  MovingMap(const fusion::QuadtreeConfig& config, SlotStore* meshes, std::size_t max_points);

  // Fuses a mesh (camera frame) at T_nav_cam; transforms it into nav. Returns the nodes updated.
  std::size_t add(Mesh& mesh, int keyframe, const SE3& T_odom_cam, const SE3& T_nav_cam);

  // Some keyframe has moved: what hangs on it is to be fused anew, from now on. False while an earlier
  // rebuild is under way: say so again later.
  bool noteMoved();
  // At most `meshes` are fused into the second map.
  void rebuild(int meshes, const PoseOf& pose_of, const OnMoved& on_moved);
  // Fuses all anew at the present poses.
  void finish(const PoseOf& pose_of, const OnMoved& on_moved);

  [[nodiscard]] const fusion::QuadtreeMap& map() const { return *shown_; }

  struct Counters {
    std::uint64_t meshes = 0, rebuilds = 0, meshes_fused_again = 0, meshes_lost = 0;
    std::size_t waiting = 0;  // meshes that the second map still has to take in
    bool given_up = false;    // too many meshes were lost: the map stays as it is
  };
  [[nodiscard]] Counters counters() const;
  [[nodiscard]] std::size_t memoryBytes() const;

 private:
  struct Entry {
    SE3 T_odom_cam;
    SE3 shown;  // T_nav_cam in the map that is shown
    SE3 next;   // and in the other
    Box box, next_box;
    int keyframe = -1;
    bool stored = false;
  };
  void begin();
  [[nodiscard]] bool tooManyLost();
  void swap(const OnMoved& on_moved);

  std::unique_ptr<fusion::QuadtreeMap> shown_, second_;
  SlotStore* meshes_;
  std::vector<Entry> entries_;  // by slot
  std::vector<std::uint8_t> block_;
  Mesh mesh_;
  std::size_t next_ = 0;
  bool building_ = false;
  Counters counters_;
};

}  // namespace fathom::onboard
