#include "realtime/onboard/localisation/keyframe_features.hpp"

#include <limits>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {}  // namespace

bool KeyframeSelection::due(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                            bool reliable, const Slack& slack) const {
  if (!last_ || !reliable) return true;
  const double apart = (seen.centre - last_->seen.centre).norm() + slack.metres;
  const double reach =
      closure::separationOfOverlap(config_.keyframe_overlap) * 0.5 * (seen.radius + last_->seen.radius);
  const double turn = T_odom_cam.rotation().angularDistance(last_->T_odom_cam.rotation()) + slack.radians;
  const double since = static_cast<double>(utc_ns - last_->utc_ns) / kNanosecondsPerSecond;
  return apart >= reach || turn >= config_.keyframe_turn || since >= config_.keyframe_s;
}

bool KeyframeSelection::take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                             bool reliable) {
  if (!due(utc_ns, T_odom_cam, seen, reliable)) return false;
  last_ = {utc_ns, T_odom_cam, seen};
  return true;
}

KeyframeFeatures::KeyframeFeatures(SlotStore* slots, int max_keyframes, int max_features,
                                   const calibration::RigHistory& rigs)
    : slots_(slots),
      rigs_(rigs),
      entries_(static_cast<std::size_t>(max_keyframes)),
      block_(closure::slotBytes(static_cast<std::size_t>(max_features))) {
  // As many slots as are ever in use, however many there are.
  free_.reserve(static_cast<std::size_t>(max_keyframes) + 1);
  for (Kept& k : newest_) k.features.reserve(static_cast<std::size_t>(max_features));
  for (Kept& k : read_) k.features.reserve(static_cast<std::size_t>(max_features));
}

std::size_t KeyframeFeatures::memoryBytes() const {
  const std::size_t frame = block_.size();
  return entries_.memoryBytes() + free_.capacity() * sizeof(std::int32_t) +
         (newest_.size() + read_.size() + 1) * frame;
}

// A slot that is free, or that of the keyframe that is missed least. -1: none at all.
std::int32_t KeyframeFeatures::freeSlot() {
  if (slots_ == nullptr || slots_->slots() == 0 || slots_->slotBytes() < block_.size()) return -1;
  if (!free_.empty()) {
    const std::int32_t slot = free_.back();
    free_.pop_back();
    return slot;
  }
  if (used_ < slots_->slots()) return static_cast<std::int32_t>(used_++);
  Entry *before = nullptr, *middle = nullptr, *least = nullptr;
  float smallest = std::numeric_limits<float>::max();
  for (const int keyframe : entries_.numbers()) {
    Entry& e = entries_[static_cast<std::size_t>(keyframe)];
    if (e.slot < 0) continue;
    if (before != nullptr) {
      const float gap = (e.place - before->place).squaredNorm();
      if (gap < smallest) {
        smallest = gap;
        least = middle;
      }
    }
    before = middle;
    middle = &e;
  }
  if (least == nullptr) least = middle;  // one or two slots: the newest is evicted
  if (least == nullptr) return -1;       // none could be written
  ++counters_.evicted;
  const std::int32_t slot = least->slot;
  least->slot = -1;
  return slot;
}

void KeyframeFeatures::add(const closure::FrameFeatures& features, const Eigen::Vector3d& place, int rig) {
  const int keyframe = entries_.add({-1, 0, rig, place.cast<float>()});
  Kept& kept = newest_[static_cast<std::size_t>(keyframe) % kNewest];
  kept.keyframe = keyframe;
  kept.rig = rig;
  kept.features = features;
  if (features.size() == 0 || !closure::writeSlot(features, block_)) return;
  const std::int32_t slot = freeSlot();
  if (slot < 0) return;
  if (slots_->write(static_cast<std::size_t>(slot), block_)) {
    Entry& entry = entries_[static_cast<std::size_t>(keyframe)];
    entry.slot = slot;
    entry.crc = crc32(block_);
    ++counters_.stored;
  } else {
    free_.push_back(slot);
    ++counters_.write_failures;
  }
}

void KeyframeFeatures::retire(int keyframe) {
  const std::int32_t slot = entries_[static_cast<std::size_t>(keyframe)].slot;
  if (slot >= 0) free_.push_back(slot);
  entries_.erase(keyframe);
}

bool KeyframeFeatures::has(int keyframe) const {
  if (!entries_.has(keyframe)) return false;
  if (entries_[static_cast<std::size_t>(keyframe)].slot >= 0) return true;
  for (const Kept& k : newest_)
    if (k.keyframe == keyframe) return k.features.size() > 0;
  return false;
}

bool KeyframeFeatures::readBlock(const Entry& e) {
  return slots_->read(static_cast<std::size_t>(e.slot), block_) && crc32(block_) == e.crc;
}

bool KeyframeFeatures::slotsHold() {
  for (const int keyframe : entries_.numbers())
    if (const Entry& e = entries_[static_cast<std::size_t>(keyframe)]; e.slot >= 0 && !readBlock(e))
      return false;
  return true;
}

const closure::FrameFeatures* KeyframeFeatures::find(int keyframe) {
  if (!entries_.has(keyframe)) return nullptr;
  for (Kept& k : newest_)
    if (k.keyframe == keyframe) return asKnownNow(k);
  for (std::size_t i = 0; i < read_.size(); ++i) {
    if (read_[i].keyframe != keyframe) continue;
    if (i == next_read_) next_read_ = (next_read_ + 1) % read_.size();  // the caller may still look at it
    return asKnownNow(read_[i]);
  }
  const Entry& e = entries_[static_cast<std::size_t>(keyframe)];
  if (e.slot < 0) return nullptr;
  Kept& into = read_[next_read_];
  next_read_ = (next_read_ + 1) % read_.size();
  into.keyframe = -1;
  if (!readBlock(e) || !closure::readSlot(block_, into.features)) {
    ++counters_.read_failures;
    return nullptr;
  }
  into.keyframe = keyframe;
  into.rig = e.rig;
  return asKnownNow(into);
}

// Triangulates them again if the rig's calibration has improved since.
const closure::FrameFeatures* KeyframeFeatures::asKnownNow(Kept& kept) const {
  const int best = rigs_.best(kept.rig);
  if (best == kept.rig) return &kept.features;
  const StereoRig& rig = rigs_.rig(best);
  for (closure::Feature& f : kept.features.features) {
    Eigen::Vector3d point;
    double gap = 0;
    if (!triangulatePixels(rig, f.left.cast<double>(), f.right.cast<double>(), point, gap)) continue;
    const auto longer = static_cast<float>(point.z()) / f.point.z();
    f.point = point.cast<float>();
    for (float& c : f.covariance) c *= longer * longer * longer * longer;  // range goes with its square
  }
  kept.rig = best;
  return &kept.features;
}

}  // namespace fathom::onboard
