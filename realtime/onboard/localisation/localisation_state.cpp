// Localisation as saved state.
#include <vector>

#include "realtime/onboard/localisation/localisation_core.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("LOCA"), kSearchTag = rt::stateTag("CLOS"), kVersion = 1,
                        kSearchVersion = 2;

template <typename Archive, typename Feature>
void exchangeFeature(Archive& archive, Feature& f) {
  archive(f.left, f.right, f.point, f.covariance, f.size);
}

template <typename Archive, typename Frame>
void exchangeFrame(Archive& archive, Frame& frame) {
  std::uint64_t count = frame.features.size();
  archive.enumeration(frame.kind, closure::DescriptorKind::kBrisk);
  archive(count);
  archive.require(frame.kind >= closure::DescriptorKind::kRootSift && count <= closure::kMaxSlotFeatures,
                  "features that cannot be");
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    frame.features.resize(count);
    frame.descriptors.resize(count * closure::descriptorBytes(frame.kind));
  }
  for (auto& f : frame.features) exchangeFeature(archive, f);
  archive.elements(frame.descriptors.data(), frame.descriptors.size());
}

}  // namespace

template <typename Archive, typename Self>
void KeyframeFeatures::exchange(Archive& archive, Self& self) {
  std::uint64_t used = self.used_, entries = self.entries_.size();
  archive(used, entries, self.counters_);
  archive.require(entries <= self.entries_.capacity(), "more keyframes than there is room for");
  if constexpr (Archive::kLoading) {
    if (!archive.ok()) return;
    self.used_ = used;
    self.entries_.resize(entries);
  }
  for (auto& e : self.entries_) archive(e.slot, e.crc, e.place);
  for (auto& kept : self.newest_) {
    archive(kept.keyframe);
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
  for (const Entry& e : entries_) {
    if (e.slot == -1) continue;
    const bool good = e.slot >= 0 && static_cast<std::size_t>(e.slot) < used_ && used_ <= slots &&
                      !met[static_cast<std::size_t>(e.slot)];
    reader.require(good, "a slot that is not there, or not free");
    if (!good) return false;
    met[static_cast<std::size_t>(e.slot)] = true;
  }
  for (const Kept& k : newest_)
    reader.require(k.keyframe >= -1 && k.keyframe < static_cast<int>(entries_.size()),
                   "features of no keyframe");
  return reader.ok();
}

template <typename Archive, typename Self>
void ClosureSearch::exchange(Archive& archive, Self& self) {
  std::uint64_t next_moved = self.next_moved_;
  archive(next_moved);
  archive.bounded(self.views_, self.views_.capacity());
  archive.bounded(self.sought_, self.sought_.capacity());
  archive.bounded(self.closures_, self.closures_.capacity());
  archive(self.tried_, self.recognised_, self.last_closed_, self.agreement_, self.counters_);
  if constexpr (Archive::kLoading) self.next_moved_ = next_moved;
}

void ClosureSearch::save(rt::StateWriter& writer) const {
  writer.section(kSearchTag, kSearchVersion, [&] {
    exchange(writer, *this);
    queue_.save(writer);
  });
  writer(places_);
}

bool ClosureSearch::load(rt::StateReader& reader) {
  const auto content = [&] {
    exchange(reader, *this);
    const int keyframes = graph_.keyframes();
    if (!reader.ok() || !queue_.load(reader, static_cast<std::size_t>(keyframes))) return;
    bool good = next_moved_ <= views_.size();
    for (std::size_t v = 0; v < views_.size(); ++v)
      good =
          good && views_[v].keyframe < keyframes && (v == 0 || views_[v - 1].keyframe < views_[v].keyframe);
    good = good && (views_.empty() || views_[0].keyframe >= 0);
    const auto isPair = [&](const auto& c) {
      return c.a >= 0 && c.a < keyframes && c.b >= 0 && c.b < keyframes && c.a != c.b;
    };
    for (const closure::Claim& c : agreement_.waiting())
      good = good && viewOf(c.a) < views_.size() && viewOf(c.b) < views_.size();
    for (const Closure& c : closures_) good = good && isPair(c);
    reader.require(good, "closures of other keyframes than there are");
  };
  return reader.section(kSearchTag, kSearchVersion, content) && reader(places_);
}

template <typename Archive, typename Self>
void LocalisationCore::exchange(Archive& archive, Self& self) {
  archive(self.selection_, self.features_, self.fixes_);
  auto& quality = self.last_quality_;
  archive(quality.unlocked_s, quality.untilted_s, quality.attitude_held, quality.depth_held,
          quality.heading_leaps);
  archive(self.last_unlocked_s_, self.loss_s_, self.position_sigma_);
  auto& c = self.counters_;
  archive(c.frames, c.frames_without_features, c.odometry_found, c.odometry_refused, c.odometry_second_tries,
          c.odometry_surprises, c.fixes_dropped);
}

void LocalisationCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
  writer(graph_, search_);
}

bool LocalisationCore::load(rt::StateReader& reader) {
  const bool good = reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
  if (!good || !reader(graph_, search_)) return false;
  reader.require(features_.keyframes() == static_cast<std::size_t>(graph_.keyframes()),
                 "features of other keyframes than there are");
  return reader.ok();
}

}  // namespace fathom::onboard
