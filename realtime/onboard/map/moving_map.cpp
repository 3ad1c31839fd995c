#include "realtime/onboard/map/moving_map.hpp"

#include <algorithm>
#include <limits>

#include "realtime/onboard/map/mesh_slot.hpp"

namespace fathom::onboard {
namespace {

// Meshes that cannot be read again would be holes in a map that is built anew; a few are covered by their
// neighbours.
constexpr double kMostLost = 0.02;  // of all meshes
// Smaller moves are not worth sending a tile again.
constexpr double kMoved = 0.01, kTurned = 0.005;  // [m], [rad]

MovingMap::Box boxOf(const Mesh& mesh) {
  MovingMap::Box box;
  if (mesh.vertices.empty()) return box;
  box.low.setConstant(std::numeric_limits<float>::max());
  box.high = -box.low;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    box.low = box.low.cwiseMin(v.head<2>());
    box.high = box.high.cwiseMax(v.head<2>());
  }
  return box;
}

}  // namespace

MovingMap::MovingMap(const fusion::QuadtreeConfig& config, SlotStore* meshes, std::size_t max_points)
    : shown_(std::make_unique<fusion::QuadtreeMap>(config)), meshes_(meshes) {
  if (meshes_ == nullptr || meshes_->slots() == 0) return;
  second_ = std::make_unique<fusion::QuadtreeMap>(config);
  entries_.reserve(meshes_->slots());
  block_.resize(meshSlotBytes(max_points));
}

std::size_t MovingMap::memoryBytes() const {
  return shown_->counters().memory_bytes + (second_ ? second_->counters().memory_bytes : 0) +
         entries_.capacity() * sizeof(Entry) + block_.size();
}

std::size_t MovingMap::add(Mesh& mesh, int keyframe, const SE3& T_odom_cam, const SE3& T_nav_cam) {
  Entry entry;
  ++counters_.meshes;
  if (second_) {
    const std::size_t bytes = writeMeshSlot(mesh, block_);
    entry.stored = entries_.size() < entries_.capacity() && bytes > 0 &&
                   meshes_->write(entries_.size(), {block_.data(), bytes});
    if (!entry.stored) ++counters_.meshes_lost;
  }
  transform(mesh, T_nav_cam);
  if (second_ && entries_.size() < entries_.capacity()) {
    entry.keyframe = keyframe;
    entry.T_odom_cam = T_odom_cam;
    entry.shown = T_nav_cam;
    entry.box = boxOf(mesh);
    entries_.push_back(entry);
  }
  return shown_->fuse(mesh);
}

// The second map numbers its changes on from the first's, so that newer content has the higher number.
void MovingMap::begin() {
  second_->clear(shown_->fused());
  next_ = 0;
  building_ = true;
}

bool MovingMap::noteMoved() {
  if (!second_ || building_ || entries_.empty()) return false;
  begin();
  return true;
}

bool MovingMap::tooManyLost() {
  counters_.given_up =
      static_cast<double>(counters_.meshes_lost) > kMostLost * static_cast<double>(counters_.meshes);
  return counters_.given_up;
}

void MovingMap::rebuild(int meshes, const PoseOf& pose_of, const OnMoved& on_moved) {
  if (!second_) return;
  if (!building_ || tooManyLost()) return;
  for (; meshes > 0 && next_ < entries_.size(); ++next_) {
    Entry& e = entries_[next_];
    e.next = pose_of(e.keyframe, e.T_odom_cam);
    if (!e.stored) continue;
    --meshes;
    if (!meshes_->read(next_, block_) || !readMeshSlot(block_, mesh_)) {
      e.stored = false;
      ++counters_.meshes_lost;
      continue;
    }
    transform(mesh_, e.next);
    e.next_box = boxOf(mesh_);
    (void)second_->fuse(mesh_);
    ++counters_.meshes_fused_again;
  }
  if (next_ == entries_.size() && !tooManyLost()) swap(on_moved);
}

void MovingMap::swap(const OnMoved& on_moved) {
  std::swap(shown_, second_);
  building_ = false;
  ++counters_.rebuilds;
  for (Entry& e : entries_) {
    if (e.stored) {
      const SE3 moved = e.shown.inverse() * e.next;
      const bool far = moved.translation().norm() > kMoved || 2 * moved.rotation().vec().norm() > kTurned;
      if (far && on_moved) on_moved(e.box, e.next_box);
      e.box = e.next_box;
    }
    e.shown = e.next;
  }
}

void MovingMap::finish(const PoseOf& pose_of, const OnMoved& on_moved) {
  if (!second_ || entries_.empty()) return;
  begin();
  rebuild(std::numeric_limits<int>::max(), pose_of, on_moved);
}

MovingMap::Counters MovingMap::counters() const {
  Counters out = counters_;
  if (building_) out.waiting = entries_.size() - next_;
  return out;
}

}  // namespace fathom::onboard
