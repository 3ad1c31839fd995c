#include "realtime/onboard/nav/nav_feed.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("NAVC"), kFeedTag = rt::stateTag("NAVF"), kVersion = 5;

template <typename Archive, typename Health>
void exchangeHealth(Archive& archive, Health& health) {
  archive(health.utc_ns, health.dvl_age, health.attitude_age, health.depth_age, health.water_age,
          health.left_age, health.right_age, health.initialised, health.odometry_age, health.altitude,
          health.depth, health.speed);
  std::uint64_t waiting = health.waiting_pairs;
  archive(waiting);
  if constexpr (Archive::kLoading) health.waiting_pairs = static_cast<std::size_t>(waiting);
  for (auto& counter : health.counters) archive(counter.value);
}

}  // namespace

template <typename Archive, typename Self>
void NavCore::exchange(Archive& archive, Self& self) {
  archive(self.odometry_, self.pairing_, self.waiting_, self.triggers_, self.dvl_, self.attitude_,
          self.depth_, self.water_, self.left_, self.right_, self.counters_);
  exchangeHealth(archive, self.health_);
}

void NavCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
}

bool NavCore::load(rt::StateReader& reader) {
  takeHealth(0);  // for the counters' names
  return reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
}

void NavFeed::save(rt::StateWriter& writer) const {
  writer(core_);
  writer.section(kFeedTag, kVersion, [&] { writer(left_clock_, right_clock_, exposures_); });
}

bool NavFeed::load(rt::StateReader& reader) {
  return reader(core_) &&
         reader.section(kFeedTag, kVersion, [&] { reader(left_clock_, right_clock_, exposures_); });
}

}  // namespace fathom::onboard
