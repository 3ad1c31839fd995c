#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/mission_run.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "recon/geometry/state_values.hpp"

// Saved state of the system as a whole and of its run; the cores' own is theirs.
namespace fathom::onboard {

template <typename Archive, typename Self>
void OnboardSystem::exchange(Archive& archive, Self& self) {
  for (auto& name : self.image_names_) archive(name.frame, name.text, name.exposure_s);
  archive(self.last_pose_, self.distance_, self.program_health_, self.skipped_cycles_, self.shed_pairs_,
          self.pairs_at_level_, self.unreadable_images_, self.fixes_without_odometry_);
  archive(self.early_fixes_, self.odometry_began_);
  archive.instants(self.last_pair_ns_, self.last_tick_ns_, self.odometry_began_ns_);
  archive(self.last_points_, self.survey_over_, self.reported_progress_, self.waiting_,
          self.last_correction_);
  bool battery = self.battery_.has_value();
  archive(battery);
  if constexpr (Archive::kLoading) {
    self.battery_.reset();
    if (battery) self.battery_.emplace();
  }
  if (!self.battery_) return;
  archive.instants(self.battery_->utc_ns);
  archive(self.battery_->voltage, self.battery_->current, self.battery_->charge);
}

void OnboardSystem::save(rt::StateWriter& writer) const {
  // Navigation first and by itself: the hard tier begins with it.
  writer(nav_);
  writer(map_, link_, downlink_);
  writer.section(rt::stateTag("PROG"), 1, [&] { writer(progress_); });
  writer.section(rt::stateTag("ONBD"), 4, [&] { exchange(writer, *this); });
}

bool OnboardSystem::load(rt::StateReader& reader) {
  return reader(nav_) && reader(map_, link_, downlink_) &&
         reader.section(rt::stateTag("PROG"), 1, [&] { reader(progress_); }) &&
         reader.section(rt::stateTag("ONBD"), 4, [&] { exchange(reader, *this); });
}

template <typename Archive, typename Self>
void MissionRun::exchange(Archive& archive, Self& self) {
  RunSummary summary = self.summary_;
  archive(summary.samples, summary.pairs, summary.pairs_used);
  FrameExchange::Counters link = self.link_.counters();
  archive(link.sent, link.sent_bytes, link.received);
  archive(self.begun_, self.inputs_, self.link_silent_);
  archive.instants(self.first_ns_, self.now_ns_, self.next_odometry_ns_, self.next_health_ns_,
                   self.last_odometry_ns_);
  if constexpr (Archive::kLoading) {
    self.summary_ = summary;
    self.link_.setCounters(link);
  }
}

void MissionRun::save(rt::StateWriter& writer) {
  system_.save(writer);
  writer.section(rt::stateTag("MRUN"), 2, [&] { exchange(writer, *this); });
  output_.save(writer);
}

bool MissionRun::rollBackSlots(std::uint64_t checkpoint) {
  bool all = true;
  eachSlotStore([&](SlotStore& slots) { all = slots.rollBack(checkpoint) && all; });
  return all;
}

bool MissionRun::slotsHold() {
  bool check = false;
  eachSlotStore([&](SlotStore& slots) { check = check || slots.needsCheck(); });
  if (check && !system_.slotsHold()) return false;
  if (check) eachSlotStore([](SlotStore& slots) { slots.checked(); });
  return true;
}

void MissionRun::forgetSlots(std::uint64_t before_checkpoint) {
  eachSlotStore([&](SlotStore& slots) { slots.forget(before_checkpoint); });
}

bool MissionRun::load(rt::StateReader& reader) {
  return system_.load(reader) && reader.section(rt::stateTag("MRUN"), 2, [&] { exchange(reader, *this); }) &&
         output_.load(reader);
}

}  // namespace fathom::onboard
