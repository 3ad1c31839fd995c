#include "recon/geometry/state_values.hpp"
#include "recon/nav/dead_reckoning.hpp"

namespace fathom::nav {
namespace {

// What is searched by time.
template <typename Queue>
bool rises(const Queue& queue) {
  for (std::size_t i = 1; i < queue.size(); ++i)
    if (queue[i].utc_ns <= queue[i - 1].utc_ns) return false;
  return true;
}

}  // namespace

template <typename Archive, typename Self>
void DeadReckoning::exchange(Archive& archive, Self& self) {
  archive.instants(self.now_);
  archive(self.dvl_times_, self.attitude_times_, self.depth_times_, self.gyro_times_, self.attitudes_,
          self.last_heading_, self.heading_taken_out_, self.leap_times_, self.depths_, self.rates_,
          self.waiting_, self.nodes_, self.last_velocity_, self.coast_velocity_, self.coasting_,
          self.depth_filter_, self.sound_speed_, self.own_sound_speed_, self.altitude_, self.counters_);
  // The track rests on both, and looks at their newest without asking.
  archive.require(self.nodes_.empty() || (!self.attitudes_.empty() && !self.depths_.empty()),
                  "a track without attitude or depth");
  archive.require(self.leap_times_.size() <= self.counters_.heading_leaps, "leaps that were not counted");
  archive.require(rises(self.nodes_) && rises(self.attitudes_) && rises(self.depths_) && rises(self.rates_),
                  "times that do not rise");
}

void DeadReckoning::save(rt::StateWriter& writer) const {
  exchange(writer, *this);
}

bool DeadReckoning::load(rt::StateReader& reader) {
  exchange(reader, *this);
  return reader.ok();
}

}  // namespace fathom::nav
