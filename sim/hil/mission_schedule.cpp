#include "sim/hil/mission_schedule.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <type_traits>
#include <utility>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/navigation/dead_reckoning/camera_clock.hpp"

namespace fathom::sim {
namespace {

// From the ping to the position on the ship.
constexpr std::int64_t kUsblProcessingNs = 300'000'000;
// Longer delays are the recorder's, not the device's.
constexpr std::int64_t kLongestLatencyNs = kSecond_ns;

std::int64_t timeOf(const SensorSample& sample) {
  return std::visit([](const auto& s) { return s.utc_ns; }, sample);
}

// UTC minus stamp by mission.toml [ns].
std::int64_t clockOffset(const SensorSample& sample, const io::MissionConfig::TimeOffsets& offsets) {
  double seconds = 0;
  if (std::holds_alternative<DvlSample>(sample)) seconds = offsets.dvl;
  if (std::holds_alternative<AttitudeSample>(sample) || std::holds_alternative<GyroSample>(sample))
    seconds = offsets.compass;
  if (std::holds_alternative<DepthSample>(sample)) seconds = offsets.depth;
  if (const auto* image = std::get_if<ImageEvent>(&sample))
    seconds = image->side == CameraSide::kLeft ? offsets.left_camera : offsets.right_camera;
  return std::llround(seconds * kNanosecondsPerSecond);
}

// Maps the mission's part from `begin` to `end` to vehicle time, for each lap.
class Laps {
 public:
  Laps(const ScheduleOptions& options, std::int64_t begin_ns, std::int64_t end_ns)
      : options_(options), begin_ns_(begin_ns), end_ns_(end_ns) {}

  [[nodiscard]] bool backward(int lap) const { return lap % 2 == 1; }
  [[nodiscard]] std::int64_t vehicleTime(std::int64_t mission_ns, int lap) const {
    const std::int64_t length = end_ns_ - begin_ns_;
    const std::int64_t along = lap * length + (backward(lap) ? end_ns_ - mission_ns : mission_ns - begin_ns_);
    if (options_.rate == 1) return options_.start_utc_ns + along;
    return options_.start_utc_ns + std::llround(static_cast<double>(along) / options_.rate);
  }
  // The factor of velocities.
  [[nodiscard]] double speed(int lap) const { return backward(lap) ? -options_.rate : options_.rate; }

 private:
  ScheduleOptions options_;
  std::int64_t begin_ns_, end_ns_;
};

// A device's sample with its stamp and its rates in vehicle time.
SensorSample inVehicleTime(SensorSample sample, std::int64_t stamp_ns, double speed) {
  std::visit([&](auto& s) { s.utc_ns = stamp_ns; }, sample);
  if (auto* dvl = std::get_if<DvlSample>(&sample); dvl != nullptr && dvl->velocity) *dvl->velocity *= speed;
  if (auto* gyro = std::get_if<GyroSample>(&sample)) {
    if (gyro->body_rate) *gyro->body_rate *= speed;
    if (gyro->heading_rate) *gyro->heading_rate *= speed;
  }
  if (auto* fix = std::get_if<UsblFix>(&sample)) fix->arrival_utc_ns = stamp_ns + kUsblProcessingNs;
  return sample;
}

void addSample(const io::LoggedSample& entry, std::int64_t offset_ns, const Laps& laps, int lap,
               MissionSchedule& out) {
  const std::int64_t stamp_ns = timeOf(entry.sample);
  const std::int64_t true_ns = laps.vehicleTime(stamp_ns + offset_ns, lap);
  if (const auto* image = std::get_if<ImageEvent>(&entry.sample)) {
    out.exposures.push_back({true_ns, image->side, image->file_name, image->exposure_s});
    return;
  }
  const std::int64_t latency_ns =
      std::holds_alternative<UsblFix>(entry.sample)
          ? kUsblProcessingNs
          : std::clamp<std::int64_t>(entry.arrival_utc_ns - stamp_ns, 0, kLongestLatencyNs);
  out.samples.push_back({true_ns + latency_ns, inVehicleTime(entry.sample, true_ns, laps.speed(lap))});
}

// Extends the samples of one kind, by due time, before and after them at the period of the first two and of
// the last two, without motion.
template <class Sample>
void extendAtRest(std::vector<ScheduledSample>& samples, double before_s, double after_s) {
  std::vector<ScheduledSample> own;
  for (const ScheduledSample& s : samples)
    if (std::holds_alternative<Sample>(s.sample)) own.push_back(s);
  if (own.size() < 2) return;
  const auto extend = [&](const ScheduledSample& from, const ScheduledSample& towards, double seconds) {
    const std::int64_t step_ns = from.due_utc_ns - towards.due_utc_ns;
    if (step_ns == 0) return;
    const auto count = static_cast<std::int64_t>(seconds * kNanosecondsPerSecond) / std::abs(step_ns);
    for (std::int64_t k = 1; k <= count; ++k) {
      ScheduledSample still = from;
      still.due_utc_ns += k * step_ns;
      auto& sample = std::get<Sample>(still.sample);
      sample.utc_ns += k * step_ns;
      if constexpr (std::is_same_v<Sample, DvlSample>) sample.velocity = Eigen::Vector3d::Zero();
      if constexpr (std::is_same_v<Sample, GyroSample>) {
        if (sample.body_rate) sample.body_rate = Eigen::Vector3d::Zero();
        if (sample.heading_rate) sample.heading_rate = 0;
      }
      samples.push_back(still);
    }
  };
  extend(own[0], own[1], before_s);
  extend(own[own.size() - 1], own[own.size() - 2], after_s);
}

}  // namespace

PlayedTimes MissionSchedule::playedTimes() const {
  PlayedTimes times;
  for (const ScheduledExposure& e : exposures)
    (e.side == CameraSide::kLeft ? times.left_s : times.right_s).push_back(missionSeconds(e.utc_ns));
  for (const ScheduledSample& s : samples)
    if (std::holds_alternative<DvlSample>(s.sample)) times.dvl_s.push_back(missionSeconds(s.due_utc_ns));
  return times;
}

MissionSchedule makeSchedule(const std::filesystem::path& mission_folder, const ScheduleOptions& options) {
  const io::MissionPaths paths(mission_folder);
  MissionSchedule schedule;
  schedule.mission = io::readMissionConfig(mission_folder);
  schedule.rig = readStereoCalib(paths.calib());
  if (io::isFeatureMission(paths))
    throw InputError(mission_folder.string(), "features/",
                     "has no pictures for a camera; give a mission with img/");

  struct Entry {
    io::LoggedSample logged;
    std::int64_t offset_ns = 0;
  };
  std::vector<Entry> entries;
  std::array<nav::CameraClock, 2> clocks;  // by CameraSide
  io::SensorLogReader reader(mission_folder);
  while (auto sample = reader.next()) {
    std::int64_t offset_ns = clockOffset(sample->sample, schedule.mission.time_offsets);
    // A recorded camera's clock drifts; the exposure time is navigation's estimate of it.
    if (const auto* image = std::get_if<ImageEvent>(&sample->sample))
      offset_ns +=
          clocks[static_cast<std::size_t>(image->side)].utcNs(image->utc_ns, sample->arrival_utc_ns) -
          image->utc_ns;
    entries.push_back({std::move(*sample), offset_ns});
  }
  const auto true_time = [](const Entry& e) { return timeOf(e.logged.sample) + e.offset_ns; };
  const auto [first, last] =
      std::minmax_element(entries.begin(), entries.end(),
                          [&](const Entry& a, const Entry& b) { return true_time(a) < true_time(b); });
  const std::int64_t begin_ns = true_time(*first) + std::llround(options.from_s * kNanosecondsPerSecond);
  std::int64_t end_ns = true_time(*last);
  if (options.seconds > 0)
    end_ns = std::min<std::int64_t>(end_ns, begin_ns + std::llround(options.seconds * kNanosecondsPerSecond));

  ScheduleOptions placed = options;
  placed.start_utc_ns += ((begin_ns - options.start_utc_ns) % kSecond_ns + kSecond_ns) % kSecond_ns;
  const Laps laps(placed, begin_ns, end_ns);
  for (int lap = 0; lap < options.laps; ++lap)
    for (const Entry& e : entries) {
      // A sample at a turning point belongs to the lap before it.
      const std::int64_t turn_ns = laps.backward(lap) ? end_ns : begin_ns;
      if (true_time(e) < begin_ns || true_time(e) > end_ns || (lap > 0 && true_time(e) == turn_ns)) continue;
      addSample(e.logged, e.offset_ns, laps, lap, schedule);
    }
  if (schedule.exposures.empty())
    throw InputError(mission_folder.string(), "",
                     "has no picture in this part; give another --from or --seconds");
  const auto sortSamples = [&] {
    std::stable_sort(schedule.samples.begin(), schedule.samples.end(),
                     [](const auto& a, const auto& b) { return a.due_utc_ns < b.due_utc_ns; });
  };
  sortSamples();
  extendAtRest<DvlSample>(schedule.samples, options.rest_before_s, options.rest_after_s);
  extendAtRest<AttitudeSample>(schedule.samples, options.rest_before_s, options.rest_after_s);
  extendAtRest<GyroSample>(schedule.samples, options.rest_before_s, options.rest_after_s);
  extendAtRest<DepthSample>(schedule.samples, options.rest_before_s, options.rest_after_s);
  sortSamples();
  std::stable_sort(schedule.exposures.begin(), schedule.exposures.end(),
                   [](const auto& a, const auto& b) { return a.utc_ns < b.utc_ns; });

  schedule.start_utc_ns = placed.start_utc_ns;
  schedule.end_utc_ns =
      laps.vehicleTime(laps.backward(options.laps - 1) ? begin_ns : end_ns, options.laps - 1);
  schedule.rate = options.rate;
  schedule.mission_begin_utc_ns = begin_ns;
  schedule.mission.start_utc_ns = placed.start_utc_ns;
  schedule.mission.time_offsets = {};
  schedule.mission.cameras.rate_hz *= options.rate;
  return schedule;
}

}  // namespace fathom::sim
