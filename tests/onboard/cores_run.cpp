#include "tests/onboard/cores_run.hpp"

#include <variant>

#include "realtime/base/bytes/state_archive.hpp"

namespace fathom::onboard::testing {
namespace {

std::vector<io::OnboardInput> inputsOf(const std::filesystem::path& folder) {
  std::uint64_t damaged = 0;
  return io::readOnboardInputs(folder, damaged);
}

NavCoreConfig navConfig(const io::MissionConfig& mission) {
  NavCoreConfig nav;
  nav.predict_pairs = false;
  nav.odometry.T_body_dvl = mission.T_body_dvl;
  nav.odometry.T_body_depth = mission.T_body_depth;
  nav.odometry.T_body_compass = mission.T_body_compass;
  nav.odometry.magnetic_declination = mission.magnetic_declination;
  nav.odometry.sound_speed = mission.water.sound_speed;
  return nav;
}

}  // namespace

RecordedMission::RecordedMission(const std::filesystem::path& folder)
    : paths(folder),
      config(readOnboardConfig(std::nullopt)),
      mission(io::readMissionConfig(folder)),
      rig(readStereoCalib(paths.calib())),
      inputs(inputsOf(folder)) {}

CoresRun::CoresRun(const RecordedMission& mission, const MapSlots& slots, Ship& ship)
    : mission_(mission),
      ship_(ship),
      pairs_(mission.paths, mission.mission, mission.rig),
      source_(pairs_.source()),
      local_(mission.mission.origin),
      nav_(navConfig(mission.mission)),
      map_(mapCoreConfig(mission.config, mission.mission, mission.rig), slots),
      link_(linkCoreConfig(mission.config, mission.mission)) {
  map_.setMovedObserver([this](const MovingMap::Box& before, const MovingMap::Box& now) {
    for (const MovingMap::Box& box : {before, now})
      if (!box.empty()) link_.noteChanged(box.low.cast<double>(), box.high.cast<double>());
  });
}

void CoresRun::consumeSample(std::int64_t now_ns, const SensorSample& sample) {
  std::visit(
      [&](const auto& s) {
        using T = std::decay_t<decltype(s)>;
        if constexpr (std::is_same_v<T, UsblFix>) {
          if (const auto pose = nav_.core().odometry().poseAt(s.utc_ns))
            map_.addFix(nav::FixKind::kUsbl, s.utc_ns, (*pose * mission_.mission.T_body_usbl).translation(),
                        local_.toLocal({s.latitude, s.longitude}), s.sigma_horizontal);
        } else if constexpr (std::is_same_v<T, ImageEvent>) {
          const std::uint32_t frame = nav_.addExposure(s.utc_ns, s.side, now_ns);
          names_.resize(frame + 1);
          names_[frame] = s.file_name;
        } else if constexpr (std::is_same_v<T, DvlSample> || std::is_same_v<T, AttitudeSample> ||
                             std::is_same_v<T, GyroSample> || std::is_same_v<T, DepthSample> ||
                             std::is_same_v<T, WaterSample>) {
          nav_.add(s);
        }
      },
      sample);
}

void CoresRun::consume(const io::OnboardInput& input) {
  const auto* sample = std::get_if<SensorSample>(&input.what);
  if (sample == nullptr) return;
  const std::int64_t now_ns = input.arrival_utc_ns;
  consumeSample(now_ns, *sample);
  while (const auto trigger = nav_.core().pollTrigger()) {
    MapInput pair;
    pair.features = source_.features(names_[trigger->left_frame_id]);
    if (pair.features == nullptr) continue;
    pair.pair_index = trigger->pair_index;
    pair.utc_ns = trigger->utc_ns;
    pair.T_odom_body = trigger->T_odom_body;
    pair.quality = trigger->quality;
    if (trigger->altitude_valid) pair.altitude = trigger->altitude;
    link_.noteMapped(map_.process(pair));
  }
  link_.offerTiles(map_.map(), now_ns);
  talk(now_ns);
}

void CoresRun::talk(std::int64_t now_ns) {
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
  while (const std::size_t bytes = link_.nextFrame(now_ns, frame)) {
    frames_.insert(frames_.end(), frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(bytes));
    constexpr int kMissed = 5;
    if (++ship_.frames % kMissed == 0) continue;
    (void)ship_.receiver.accept(std::span<const std::uint8_t>(frame).first(bytes),
                                [](const auto&) { return true; });
    if (ship_.receiver.turn())
      link_.acknowledge(ship_.receiver.acknowledgement(), now_ns,
                        [this](const fusion::TileKey& square) { map_.noteSent(square); });
  }
}

void CoresRun::save(rt::StateWriter& writer) const {
  writer(nav_, map_, link_);
  writer.section(rt::stateTag("NAME"), 1, [&] { writer(names_); });
}

bool CoresRun::load(rt::StateReader& reader) {
  return reader(nav_, map_, link_) && reader.section(rt::stateTag("NAME"), 1, [&] { reader(names_); });
}

}  // namespace fathom::onboard::testing
