#include "realtime/onboard/replay.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "firmware_if/feature_file.hpp"
#include "firmware_if/image_file.hpp"
#include "firmware_if/sensor_log.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/onboard/map/mesh_slot.hpp"
#include "realtime/onboard/onboard_output.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "realtime/onboard/slots/slot_file.hpp"
#include "realtime/onboard/stage_clock.hpp"

namespace fathom::onboard {
namespace {

constexpr double kNanoseconds = 1e9;  // in a second
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Images or features of a recorded mission; holds one pair.
class RecordedImages {
 public:
  RecordedImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig)
      : paths_(paths), cameras_(mission.cameras), rig_(rig) {}

  // Of images, or of features where the mission has these instead.
  [[nodiscard]] OnboardSystem::PairSource source() {
    if (io::isFeatureMission(paths_))
      return {{}, [this](const std::string& left_image) { return readFeatures(left_image); }};
    return {[this](const std::string& name, CameraSide side) { return read(name, side); }, {}};
  }

  std::optional<ImageView> read(const std::string& name, CameraSide side) {
    const bool left = side == CameraSide::kLeft;
    const Camera& camera = left ? rig_.left : rig_.right;
    io::ImageFile& slot = left ? left_ : right_;
    const auto start = Clock::now();
    try {
      slot = io::readImage(paths_.images() / name, left ? cameras_.left_format : cameras_.right_format,
                           cameras_.bits, camera.width, camera.height);
    } catch (const InputError& e) {
      refuse(e);
      seconds_ += secondsSince(start);
      return std::nullopt;
    }
    seconds_ += secondsSince(start);
    return slot.view;
  }

  const StereoFeatureFrame* readFeatures(const std::string& left_image) {
    const auto start = Clock::now();
    const StereoFeatureFrame* read = &features_;
    try {
      io::readFeatureFile(paths_.features() / io::featureFileName(left_image), features_);
    } catch (const InputError& e) {
      refuse(e);
      read = nullptr;
    }
    seconds_ += secondsSince(start);
    return read;
  }
  [[nodiscard]] double seconds() const { return seconds_; }
  // Why the first unreadable image was refused; "" if all were read.
  [[nodiscard]] const std::string& firstRefusal() const { return first_refusal_; }

 private:
  void refuse(const InputError& e) {
    if (unreadable_ == 0) first_refusal_ = e.what();
    if (unreadable_++ < kMaxWarnings)
      std::fprintf(stderr, "fathom-onboard: %s; the pair is dropped\n", e.what());
  }

  static constexpr int kMaxWarnings = 5;  // the rest is in the counters
  io::MissionPaths paths_;
  StereoFeatureFrame features_;
  io::MissionConfig::Cameras cameras_;
  StereoRig rig_;
  io::ImageFile left_, right_;
  int unreadable_ = 0;
  std::string first_refusal_;
  double seconds_ = 0;
};

// A bar on a terminal; elsewhere a line every tenth of the way.
class Progress {
 public:
  explicit Progress(double total_s) : total_s_(total_s), terminal_(::isatty(STDERR_FILENO) == 1) {}
  void show(double done_s, std::uint64_t pairs, std::uint64_t frames) {
    const int percent = total_s_ > 0 ? static_cast<int>(100 * std::min(done_s / total_s_, 1.0)) : 100;
    const int step = terminal_ ? 1 : 10;
    if (percent / step == shown_) return;
    shown_ = percent / step;
    std::fprintf(stderr, "%sreplay %3d %%: %llu pairs mapped, %llu frames sent%s", terminal_ ? "\r" : "",
                 percent, static_cast<unsigned long long>(pairs), static_cast<unsigned long long>(frames),
                 terminal_ ? "" : "\n");
  }
  ~Progress() {
    if (terminal_ && shown_ >= 0) std::fputc('\n', stderr);
  }

 private:
  double total_s_;
  bool terminal_;
  int shown_ = -1;
};

std::vector<io::LoggedSample> readSamples(const std::filesystem::path& mission, std::uint64_t& damaged) {
  io::SensorLogReader reader(mission);
  std::vector<io::LoggedSample> samples;
  while (auto sample = reader.next()) samples.push_back(std::move(*sample));
  damaged = reader.damagedEntries();
  return samples;
}

nlohmann::ordered_json reportOf(const ReplaySummary& summary, const OnboardSystem& system,
                                const io::MissionConfig& mission) {
  nlohmann::ordered_json report;
  report["vehicle"] = mission.vehicle_name;
  report["dive_id"] = mission.dive_id;
  report["mission_s"] = summary.mission_s;
  report["samples"] = summary.samples;
  report["damaged_entries"] = summary.damaged_entries;
  report["pairs"] = summary.pairs;
  report["pairs_used"] = summary.pairs_used;
  report["mapped_area_m2"] = summary.mapped_area;
  report["frames"] = summary.frames;
  report["frame_bytes"] = summary.frame_bytes;
  report["frames_received"] = summary.frames_received;
  report["anchored"] = system.map().anchored();
  report["T_nav_odom_m"] = {system.map().T_nav_odom().translation().x(),
                            system.map().T_nav_odom().translation().y(),
                            system.map().T_nav_odom().translation().z()};
  report["lighting"] = {{"left", lighting::nameOf(system.map().leftLight().used())},
                        {"right", lighting::nameOf(system.map().rightLight().used())}};
  for (const auto& [name, value] : system.health()) report["health"][name] = value;
  return report;
}

// Pools for the mission at hand: its exposures bound the pairs, and these the keyframes.
void fitToMission(OnboardConfig& config, const std::vector<io::LoggedSample>& samples) {
  int exposures = 0;
  for (const io::LoggedSample& s : samples)
    if (const auto* image = std::get_if<ImageEvent>(&s.sample)) exposures += image->side == CameraSide::kLeft;
  config.max_pairs = std::clamp(exposures, 1, config.max_pairs);
  config.localisation.max_keyframes = std::clamp(exposures, 2, config.localisation.max_keyframes);
}

struct Slots {
  std::unique_ptr<SlotFile> features, meshes;
};

Slots makeSlots(const OnboardConfig& config, const std::filesystem::path& beside) {
  if (!config.localisation.enabled) return {};
  const std::filesystem::path folder = config.slot_folder.empty() ? beside : config.slot_folder;
  const auto slot_bytes = closure::slotBytes(closure::DescriptorKind::kRootSift,
                                             static_cast<std::size_t>(config.localisation.features));
  return {std::make_unique<SlotFile>(folder, static_cast<std::size_t>(config.localisation.max_keyframes),
                                     slot_bytes),
          std::make_unique<SlotFile>(folder, static_cast<std::size_t>(config.max_pairs),
                                     meshSlotBytes(static_cast<std::size_t>(config.stereo.max_features)))};
}

double milliseconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-6;
}

}  // namespace

ReplaySummary replay(const ReplayOptions& options) {
  const io::MissionPaths paths(options.mission);
  OnboardConfig config = readOnboardConfig(options.config);
  if (!config.warning.empty()) std::fprintf(stderr, "fathom-onboard: warning: %s\n", config.warning.c_str());
  if (options.no_slam) config.localisation.enabled = false;
  const io::MissionConfig mission = io::readMissionConfig(options.mission);
  const StereoRig rig = readStereoCalib(paths.calib());

  ReplaySummary summary;
  const std::vector<io::LoggedSample> samples = readSamples(options.mission, summary.damaged_entries);
  const std::int64_t first_ns = samples.front().arrival_utc_ns, last_ns = samples.back().arrival_utc_ns;
  summary.mission_s = static_cast<double>(last_ns - first_ns) / kNanoseconds;

  const auto start = Clock::now();
  RecordedImages images(paths, mission, rig);
  OnboardOutput output(options.out.value_or(paths.onboard()), mission.origin);
  fitToMission(config, samples);
  const Slots slots = makeSlots(config, output.folder());
  OnboardSystem system(config, mission, rig, images.source(), {slots.features.get(), slots.meshes.get()});
  StageClock stages;
  system.setStageObserver([&](const char* stage) { stages.ended(stage); });
  FrameExchange link(output, options.link, first_ns);
  Progress progress(summary.mission_s);

  std::int64_t next_odometry_ns = first_ns, next_health_ns = first_ns, last_odometry_ns = 0;
  for (const io::LoggedSample& logged : samples) {
    const auto before = Clock::now();
    stages.begin();
    const double image_seconds_before = images.seconds();
    system.consume(logged.arrival_utc_ns, logged.sample, [&](const OnboardSystem::MappedPair& pair) {
      output.addStereoPose(pair.output, pair.left_image, pair.right_image, pair.altitude.value_or(0.0));
      if (pair.output.points > 0) ++summary.pairs_used;
      ++summary.pairs;
    });
    const double core_s = secondsSince(before) - (images.seconds() - image_seconds_before);
    summary.stereo_and_map_s += core_s;
    stages.endSample(core_s);
    ++summary.samples;
    const std::int64_t now = logged.arrival_utc_ns;
    if (now >= next_odometry_ns) {
      const nav::DeadReckoning& odometry = system.nav().odometry();
      const std::int64_t newest = odometry.newestUtcNs();
      const auto pose = newest > last_odometry_ns ? odometry.poseAt(newest) : std::nullopt;
      if (pose) output.addOdometry(newest, *pose);
      last_odometry_ns = std::max(last_odometry_ns, newest);
      next_odometry_ns = now + static_cast<std::int64_t>(config.odometry_interval * kNanoseconds);
    }
    if (now >= next_health_ns) {
      output.addHealth(now, system.health());
      next_health_ns = now + static_cast<std::int64_t>(config.health_interval * kNanoseconds);
    }
    link.exchange(system, now, false);
    progress.show(static_cast<double>(now - first_ns) / kNanoseconds, summary.pairs, link.counters().sent);
  }

  const auto before_finish = Clock::now();
  system.finish(last_ns);
  const double finish_s = secondsSince(before_finish);
  constexpr std::int64_t kDrainStep = 100'000'000;  // [ns]
  const std::int64_t drain_end = last_ns + static_cast<std::int64_t>(options.drain_s * kNanoseconds);
  for (std::int64_t now = last_ns; now <= drain_end; now += kDrainStep) {
    link.exchange(system, now, true);
    if (system.link().drained()) break;
  }

  summary.frames = link.counters().sent;
  summary.frame_bytes = link.counters().sent_bytes;
  summary.frames_received = link.counters().received;
  summary.wall_s = secondsSince(start);
  summary.mapped_area = system.link().mappedArea();
  const Mesh map = fusion::toMesh(system.map().map());
  if (map.empty())
    throw InputError(options.mission.string(), "img/",
                     "no stereo pair gave a map; see onboard counters: " + std::to_string(summary.pairs) +
                         " pairs, " + std::to_string(system.unreadableImages()) + " unreadable images" +
                         (images.firstRefusal().empty() ? "" : "; the first: " + images.firstRefusal()));
  output.writeMap(map);
  output.placeStereoPoses([&](const MapOutput& pair) { return system.map().poseOf(pair); });
  if (const LocalisationCore* localisation = system.map().localisation()) output.writeClosures(*localisation);
  output.writeText("report.json", reportOf(summary, system, mission).dump(2) + "\n");
  nlohmann::ordered_json timing;
  timing["wall_s"] = summary.wall_s;
  timing["image_reading_s"] = images.seconds();
  timing["cores_s"] = summary.stereo_and_map_s;
  timing["cores_ms_per_pair"] =
      summary.pairs ? 1e3 * summary.stereo_and_map_s / static_cast<double>(summary.pairs) : 0.0;
  timing["finish_s"] = finish_s;
  for (const auto& [name, times] : stages.stages())
    timing["stages_ms"][name] = {{"frames", times.count()},
                                 {"p50", milliseconds(times.percentile(50))},
                                 {"p99", milliseconds(times.percentile(99))},
                                 {"max", milliseconds(times.max())}};
  timing["modem_refused_frames"] = link.counters().refused;
  output.writeText("timing.json", timing.dump(2) + "\n");
  output.commit();
  summary.unreadable_images = system.unreadableImages();
  return summary;
}

}  // namespace fathom::onboard
