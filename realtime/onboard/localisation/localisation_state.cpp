// Localisation as saved state.
#include <algorithm>
#include <vector>

#include "realtime/onboard/localisation/localisation_core.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("LOCA"), kSearchTag = rt::stateTag("CLOS"), kVersion = 9,
                        kSearchVersion = 3;

template <typename Archive, typename Feature>
void exchangeFeature(Archive& archive, Feature& f) {
  archive(f.left, f.right, f.point, f.covariance, f.size);
}

template <typename Archive, typename Frame>
void exchangeFrame(Archive& archive, Frame& frame) {
  std::uint64_t count = frame.features.size();
  std::uint8_t kind = closure::kSlotKind;
  archive(kind, count);
  archive.require(kind == closure::kSlotKind && count <= closure::kMaxSlotFeatures,
                  "features that cannot be");
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    frame.features.resize(count);
    frame.descriptors.resize(count * closure::kDescriptorBytes);
  }
  for (auto& f : frame.features) exchangeFeature(archive, f);
  archive.elements(frame.descriptors.data(), frame.descriptors.size());
}

}  // namespace

template <typename Archive, typename Self>
void KeyframeFeatures::exchange(Archive& archive, Self& self) {
  std::uint64_t used = self.used_;
  archive(used, self.counters_, self.entries_);
  archive.bounded(self.free_, self.free_.capacity());
  if constexpr (Archive::kLoading) self.used_ = used;
  const int newest = self.rigs_.newest();
  for (auto& kept : self.newest_) {
    archive(kept.keyframe, kept.rig);
    archive.require(kept.rig >= 0 && kept.rig <= newest, "features seen through no rig");
    if (kept.keyframe >= 0) exchangeFrame(archive, kept.features);
  }
}

void KeyframeFeatures::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool KeyframeFeatures::load(rt::StateReader& reader) {
  exchange(reader, *this);
  // What was read from the slots is read again.
  for (Kept& k : read_) k.keyframe = -1;
  next_read_ = 0;
  if (!reader.ok()) return false;
  const std::size_t slots = slots_ == nullptr ? 0 : slots_->slots();
  std::vector<bool> met(slots);
  reader.require(used_ <= slots, "more slots than there are");
  const auto meet = [&](std::int32_t slot) {
    const bool good = slot >= 0 && static_cast<std::size_t>(slot) < used_ && used_ <= slots &&
                      !met[static_cast<std::size_t>(slot)];
    reader.require(good, "a slot that is not there, or not free");
    if (good) met[static_cast<std::size_t>(slot)] = true;
  };
  for (const std::int32_t slot : free_) meet(slot);
  for (const int k : entries_.numbers()) {
    const std::int32_t rig = entries_[static_cast<std::size_t>(k)].rig;
    reader.require(rig >= 0 && rig <= rigs_.newest(), "features seen through no rig");
    if (const std::int32_t slot = entries_[static_cast<std::size_t>(k)].slot; slot != -1) meet(slot);
  }
  for (const Kept& k : newest_)
    reader.require(k.keyframe >= -1 && k.keyframe < entries_.next(), "features of no keyframe");
  return reader.ok();
}

template <typename Archive, typename Self>
void OnlineClosureSearch::exchange(Archive& archive, Self& self) {
  std::uint64_t next_moved = self.next_moved_;
  archive(next_moved);
  archive.bounded(self.views_, self.views_.capacity());
  archive.bounded(self.sought_, self.sought_.capacity());
  archive.bounded(self.closures_, self.closures_.capacity());
  archive(self.tried_, self.recognised_, self.last_closed_, self.agreement_, self.counters_);
  if constexpr (Archive::kLoading) self.next_moved_ = next_moved;
}

void OnlineClosureSearch::save(rt::StateWriter& writer) const {
  writer.section(kSearchTag, kSearchVersion, [&] {
    exchange(writer, *this);
    queue_.save(writer);
  });
  writer(places_);
}

bool OnlineClosureSearch::load(rt::StateReader& reader) {
  const auto content = [&] {
    exchange(reader, *this);
    const int keyframes = graph_.keyframes();
    if (!reader.ok() || !queue_.load(reader, static_cast<std::size_t>(keyframes))) return;
    bool good = next_moved_ <= views_.size() &&
                std::ranges::equal(views_, graph_.living(), {}, [](const View& v) { return v.keyframe; });
    for (const closure::Claim& c : agreement_.waiting())
      good = good && viewOf(c.a) < views_.size() && viewOf(c.b) < views_.size();
    for (const Closure& c : closures_)
      good = good && c.a >= 0 && c.a < keyframes && c.b >= 0 && c.b < keyframes && c.a != c.b;
    reader.require(good, "closures of other keyframes than there are");
  };
  return reader.section(kSearchTag, kSearchVersion, content) && reader(places_);
}

template <typename Archive, typename Self>
void LocalisationCore::exchange(Archive& archive, Self& self) {
  archive(self.selection_, self.features_, self.fixes_, self.last_quality_);
  archive(self.usbl_wander_, self.last_unlocked_s_, self.loss_, self.position_sigma_, self.renew_,
          self.renew_end_);
  archive(self.renew_from_, self.seen_through_, self.curl_, self.curl_sigma_);
  archive.require(self.seen_through_ >= 0 && self.seen_through_ <= self.rigs_.newest(),
                  "visual odometry seen through no rig");
  for (auto& looked : self.looked_) {
    archive(looked.waits, looked.rig);
    archive.require(looked.rig >= 0 && looked.rig <= self.rigs_.newest(), "features seen through no rig");
    if (looked.waits) exchangeFrame(archive, looked.features);
  }
  auto& c = self.counters_;
  archive(c.frames, c.frames_without_features, c.odometry_found, c.odometry_refused, c.odometry_second_tries,
          c.odometry_surprises, c.odometry_renewed, c.fixes_dropped);
}

void LocalisationCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
  writer(graph_, search_);
}

bool LocalisationCore::load(rt::StateReader& reader) {
  const bool good = reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
  if (!good || !reader(graph_, search_)) return false;
  reader.require(std::ranges::equal(features_.keyframes(), graph_.living()),
                 "features of other keyframes than there are");
  return reader.ok();
}

}  // namespace fathom::onboard
