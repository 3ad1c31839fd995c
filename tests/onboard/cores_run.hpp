#pragma once

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/onboard/link/link_core.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "realtime/onboard/nav/nav_core.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "realtime/onboard/recorded_pairs.hpp"
#include "telemetry/ship/link_receiver.hpp"

namespace fathom::onboard::testing {

// A recorded mission of features, and where it is.
struct RecordedMission {
  explicit RecordedMission(const std::filesystem::path& folder);

  io::MissionPaths paths;
  OnboardConfig config;
  io::MissionConfig mission;
  StereoRig rig;
  std::vector<io::OnboardInput> inputs;
};

// A ship that misses every fifth frame and answers at once when it is its turn.
struct Ship {
  telemetry::LinkReceiver receiver;
  int frames = 0;
};

// The three cores without a program around them: inputs in, frames and poses out.
class CoresRun {
 public:
  CoresRun(const RecordedMission& mission, const MapSlots& slots, Ship& ship);

  void consume(const io::OnboardInput& input);
  void finish() { map_.finish(); }

  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

  [[nodiscard]] const MapCore& map() const { return map_; }
  [[nodiscard]] const LinkCore& link() const { return link_; }
  [[nodiscard]] const NavFeed& nav() const { return nav_; }
  // Frames since the start, one after the other.
  [[nodiscard]] const std::vector<std::uint8_t>& frames() const { return frames_; }

 private:
  void consumeSample(std::int64_t now_ns, const SensorSample& sample);
  void talk(std::int64_t now_ns);

  const RecordedMission& mission_;
  Ship& ship_;
  RecordedPairs pairs_;
  OnboardSystem::PairSource source_;
  LocalTransverseMercator local_;
  NavFeed nav_;
  MapCore map_;
  LinkCore link_;
  std::vector<std::string> names_;  // of exposures
  std::vector<std::uint8_t> frames_;
};

}  // namespace fathom::onboard::testing
