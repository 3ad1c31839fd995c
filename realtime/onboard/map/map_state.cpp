// The soft tier's core as saved state.
#include <algorithm>

#include "realtime/onboard/map/map_core.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("MAPC"), kMovingTag = rt::stateTag("MOVE"), kVersion = 6;
// No mesh is so large [m]; every square of a moved mesh's box is visited.
constexpr float kLargestBox = 1000;

bool isBox(const MovingMap::Box& box) {
  if (box.empty()) return true;
  const Eigen::Array2f size = box.high - box.low;
  return box.low.allFinite() && box.high.allFinite() && (size <= kLargestBox).all() && (size >= 0).all();
}

}  // namespace

template <typename Archive, typename Self>
void MovingMap::exchange(Archive& archive, Self& self) {
  auto& c = self.counters_;
  std::uint64_t cursor = self.cursor_, to_compare = self.to_compare_;
  archive(c.meshes, c.meshes_fused_again, c.rebuilds, c.meshes_lost, c.meshes_baked_in, cursor, to_compare,
          self.fusions_);
  archive.bounded(self.entries_, self.entries_.capacity());
  archive.bounded(self.keyframe_, self.keyframe_.capacity());
  archive.bounded(self.fused_, self.fused_.capacity());
  archive.bounded(self.urgency_, self.urgency_.capacity());
  if constexpr (Archive::kLoading) {
    self.cursor_ = cursor;
    self.to_compare_ = to_compare;
  }
}

void MovingMap::save(rt::StateWriter& writer) const {
  writer(map_);
  writer.section(kMovingTag, kVersion, [&] { exchange(writer, *this); });
}

bool MovingMap::load(rt::StateReader& reader, const std::function<bool(int keyframe)>& has) {
  if (!reader(map_)) return false;
  return reader.section(kMovingTag, kVersion, [&] {
    exchange(reader, *this);
    reader.require(urgency_.size() == entries_.size() && keyframe_.size() == entries_.size() &&
                       fused_.size() == entries_.size() && cursor_ <= entries_.size() &&
                       to_compare_ <= entries_.size(),
                   "meshes that were not compared");
    for (const int keyframe : keyframe_)
      reader.require(keyframe == -1 || has(keyframe), "a mesh of no keyframe");
    for (const Entry& e : entries_) {
      reader.require(e.bytes <= block_.size(), "a mesh larger than its slot");
      reader.require(e.rig >= 0 && e.rig <= e.shown_rig && e.shown_rig <= rigs_.newest(),
                     "a mesh seen through no rig");
    }
    if (!reader.ok()) return;
    for (Entry& e : entries_)
      if (!isBox(e.box)) e.box = {};
    waiting_ = static_cast<std::size_t>(
        std::count_if(urgency_.begin(), urgency_.end(), [](std::uint8_t u) { return u > 0; }));
  });
}

template <typename Archive, typename Self>
void MapCore::exchange(Archive& archive, Self& self) {
  bool localised = self.localisation_ != nullptr;
  archive(localised);
  archive.require(localised == (self.localisation_ != nullptr), "localisation was switched on or off");
  archive(self.last_gps_ns_, self.anchor_, self.T_nav_odom_, self.frame_fixed_, self.anchored_,
          self.anchor_sigma_, self.last_range_, self.new_ground_, self.rig_, self.measured_ns_);
  auto& c = self.counters_;
  archive(c.pairs, c.pairs_without_points, c.bad_images, c.points, c.rejected);
}

void MapCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
  writer(left_light_, right_light_);
  if (localisation_) writer(*localisation_);
  writer(map_);
}

bool MapCore::load(rt::StateReader& reader) {
  const bool good = reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
  if (good) useRig(rig_.rig());
  if (!good || !reader(left_light_, right_light_)) return false;
  if (localisation_ && !reader(*localisation_)) return false;
  return map_.load(reader, [this](int keyframe) { return localisation_ && localisation_->has(keyframe); });
}

}  // namespace fathom::onboard
