#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/onboard/slots/slot_store.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/fusion/quadtree_map.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/navigation/graph/navigation_graph.hpp"

namespace fathom::onboard {

// A local mesh as a block of bytes, without loss: u32 magic "FLM1", u16 vertices, u16 zero, u32 triangles;
// for each vertex x y z sigma (f32), for each triangle three u16, for each vertex three colour bytes. Little
// endian. Normals are not kept; a mesh has sigma and colours.
//
// meshSlotBytes(): size for a mesh of `max_points` points; a triangulation has fewer than twice as many
// triangles.

// Of a mesh of so many points: a triangulation has fewer than twice as many triangles.
[[nodiscard]] std::size_t meshSlotBytes(std::size_t max_points);
// Bytes used; 0 when the mesh does not fit.
[[nodiscard]] std::size_t writeMeshSlot(const Mesh& mesh, std::span<std::uint8_t> slot);
// False, leaving an empty mesh, for bytes that are no mesh.
[[nodiscard]] bool readMeshSlot(std::span<const std::uint8_t> slot, Mesh& mesh);

// Map of meshes that are anchored to keyframes and follow their corrections. Every local mesh is kept in a
// slot, in its camera's frame; when the slots are full, the mesh that has not moved for longest is fixed in
// the map for good and its slot reused. When keyframes have moved, the meshes that moved most are removed
// from the map at their old pose and added at the new one, a few per frame, the newest first among equal
// moves. A mesh measured through an outdated rig calibration is triangulated again at that occasion. Each
// mesh is in the map exactly once at all times. Moves below a threshold accumulate until they exceed it;
// after finish() every mesh is at its final pose, and the map is, bit by bit, the one fused from the final
// poses (unless the map's pool was full and coarsened: then its sums are those of the final poses in the
// remaining squares). A mesh with a slot that cannot be read, or has other content than written, stays where
// it is and is counted.
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

  // `meshes`: null, or without slots, for a map that never moves. `rigs` must outlive it.
  MovingMap(const fusion::QuadtreeConfig& config, SlotStore* meshes, std::size_t max_points,
            const calibration::RigHistory& rigs);

  // Fuses a mesh (camera frame) at T_nav_cam; transforms `mesh` into nav.
  struct Added {
    std::size_t cells = 0;  // observed
    std::size_t slot = 0;
  };
  Added add(Mesh& mesh, int keyframe, const SE3& T_odom_cam, const SE3& T_nav_cam);
  // Final pose and keyframe of a mesh that was added at a predicted pose: it is moved like those with moved
  // keyframes, unless it was fixed for good.
  void correct(std::size_t slot, const SE3& guessed, int keyframe, const SE3& T_odom_cam,
               const PoseOf& pose_of);

  // Anchors the meshes of a retired keyframe to its successor, where they are.
  void reattach(const slam::NavigationGraph::Retired& gone);
  // A keyframe has moved, or the rig calibration has improved: rebuild() checks all meshes again. False for a
  // map that never moves.
  bool noteMoved();
  // Moves at most `meshes` meshes, which also bounds the slots read.
  void rebuild(int meshes, const PoseOf& pose_of, const OnMoved& on_moved);
  // Moves all meshes to their final poses, however small the move.
  void finish(const PoseOf& pose_of, const OnMoved& on_moved);

  [[nodiscard]] bool moves() const { return meshes_ != nullptr; }
  [[nodiscard]] const fusion::QuadtreeMap& map() const { return map_; }
  // For the worth of areas when the pool is full: see QuadtreeMap.
  void noteVehicle(const Eigen::Vector2d& north_east) { map_.noteVehicle(north_east); }
  void noteSent(const fusion::TileKey& key) { map_.noteSent(key); }

  struct Counters {
    std::uint64_t meshes = 0, meshes_fused_again = 0;
    std::uint64_t rebuilds = 0;         // times that all waiting meshes were worked off
    std::uint64_t meshes_lost = 0;      // without a slot that can be read: they stay where they are
    std::uint64_t meshes_baked_in = 0;  // fixed for good, for lack of slots
    std::size_t waiting = 0;            // known to have moved
    bool given_up = false;              // so many are lost that the map no longer follows the poses well
  };
  [[nodiscard]] Counters counters() const;
  // All that is held in memory; the slots are the caller's.
  [[nodiscard]] std::size_t memoryBytes() const;

  // Whether every slot in use holds what was written; reads all of them.
  [[nodiscard]] bool slotsHold();
  // Bit by bit, into one of the same configuration with the same slots; `has`: whether there is a keyframe.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, const std::function<bool(int keyframe)>& has);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);

  struct Entry {
    SE3 T_odom_cam;
    SE3 shown;                   // T_nav_cam in the map
    Eigen::Vector3f middle;      // of the mesh, in the camera's frame
    float radius = 0;            // [m]
    int rig = 0, shown_rig = 0;  // versions of the rig of its points in the slot, and in the map
    Box box;
    std::uint64_t hash = 0;  // of the slot's content
    std::uint32_t bytes = 0;
    bool stored = false;
    bool fused = false;  // the map had room for it

    static void exchange(auto& archive, auto& self) {
      archive(self.T_odom_cam, self.shown, self.middle, self.radius, self.rig, self.shown_rig, self.box.low,
              self.box.high, self.hash, self.bytes, self.stored, self.fused);
    }
  };
  [[nodiscard]] std::size_t slotFor();
  void compareSome(std::size_t entries, const PoseOf& pose_of);
  void compare(std::size_t entry, const PoseOf& pose_of);
  void setUrgency(std::size_t entry, std::uint8_t urgency);
  [[nodiscard]] bool readBlock(std::size_t entry);
  [[nodiscard]] bool readMesh(std::size_t entry);
  void through(int from, int to, Mesh& mesh) const;
  // False when the slot could not be read.
  bool move(std::size_t entry, const SE3& T_nav_cam, const OnMoved& on_moved);

  fusion::QuadtreeMap map_;
  SlotStore* meshes_;
  const calibration::RigHistory& rigs_;
  std::vector<Entry> entries_;         // by slot
  std::vector<int> keyframe_;          // of each entry
  std::vector<std::uint32_t> fused_;   // of each: number of the fusion that put it where it is
  std::vector<std::uint8_t> urgency_;  // of each: logarithm of its move; 0: need not move
  std::uint32_t fusions_ = 0;
  std::size_t waiting_ = 0;                  // entries with an urgency
  std::size_t cursor_ = 0, to_compare_ = 0;  // entries before the cursor are compared next, newest first
  std::vector<std::uint8_t> block_;
  Mesh mesh_, moved_;
  Counters counters_;
};

}  // namespace fathom::onboard
