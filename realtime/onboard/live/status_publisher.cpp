#include "realtime/onboard/live/status_publisher.hpp"

#include <algorithm>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/mapper/mapper_tier.hpp"

namespace fathom::onboard {
namespace {

constexpr int kCellsPerTile = 16;

void addReportedStage(const rt::StageSummary& s, io::HealthReport& report) {
  if (s.count > 0)
    report.stages.add({s.name, s.count, s.misses, rt::milliseconds(s.last_ns), rt::milliseconds(s.p50_ns),
                       rt::milliseconds(s.p99_ns), rt::milliseconds(s.max_ns)});
}

}  // namespace

StatusPublisher::StatusPublisher(LiveSystem& live, std::shared_ptr<io::LcmBus> bus,
                                 const io::MissionConfig& mission, const std::filesystem::path& folder,
                                 const Config& config, const rt::VehicleClock& clock)
    : live_(live),
      publisher_(bus ? std::make_unique<io::LcmPublisher>(std::move(bus), mission.vehicle_name) : nullptr),
      local_(mission.origin),
      config_(config),
      root_size_(live.config().map.root_size),
      max_level_(live.config().map.max_level),
      clock_(clock),
      system_(folder),
      begin_ns_(clock.monotonicNs()) {}

void StatusPublisher::publish(const io::LogMessage& message) {
  if (publisher_) publisher_->publish(message);
  (void)log(message);
}

bool StatusPublisher::log(const io::LogMessage& message) {
  return live_.recorder().offerMessage(config_.lane, clock_.utcNs(), message.channel, message.data);
}

void StatusPublisher::step() {
  const std::int64_t now = clock_.monotonicNs();
  (void)live_.hard().readForBus(nav_);
  (void)live_.mapper().up().readMap(map_);
  if (config_.pose_hz > 0 && now >= next_pose_ns_) {
    const auto period = static_cast<std::int64_t>(static_cast<double>(kSecond_ns) / config_.pose_hz);
    // Keeps its pace, but makes up for nothing.
    next_pose_ns_ = std::max(next_pose_ns_ + period, now);
    publishPose();
  }
  if (now < next_slow_ns_) return;
  next_slow_ns_ = now + kSecond_ns;
  setOwnStatus();
  publishSlow();
}

std::int64_t StatusPublisher::restNs() const {
  constexpr std::int64_t kLongest = 50'000'000, kShortest = 1'000'000;
  if (config_.pose_hz <= 0) return kLongest;
  return std::clamp(next_pose_ns_ - clock_.monotonicNs(), kShortest, kLongest);
}

// Status for the ship while no mapper runs: the position by dead reckoning.
void StatusPublisher::setOwnStatus() {
  telemetry::Status status = map_.status;
  status.utc_ns = nav_.pose_utc_ns != 0 ? nav_.pose_utc_ns : clock_.utcNs();
  placeIn(status, map_.T_nav_odom * nav_.T_odom_body);
  status.altitude = nav_.altitude.value_or(telemetry::kAbsent);
  status.speed = nav_.velocity_body.norm();
  status.map_area = map_.mapped_area;
  status.health = static_cast<std::uint16_t>(status.health | telemetry::kHealthNoMap);
  if (!map_.anchored) status.health = static_cast<std::uint16_t>(status.health | telemetry::kHealthNoFix);
  live_.ownStatus().set(status, live_.parts().read("mapper").state == PartState::kRunning);
}

void StatusPublisher::publishPose() {
  // From another process: anything.
  const bool known = map_.anchored && map_.T_nav_odom.translation().allFinite() &&
                     map_.T_nav_odom.rotation().coeffs().allFinite();
  if (nav_.pose_utc_ns == 0 || !known) return;
  const SE3 T_nav_body = map_.T_nav_odom * nav_.T_odom_body;
  io::PoseReport pose;
  pose.utc_ns = nav_.pose_utc_ns;
  pose.position = T_nav_body.translation();
  pose.attitude = T_nav_body.rotation();
  const Geodetic place = local_.toGeodetic(pose.position.head<2>());
  pose.latitude = place.latitude;
  pose.longitude = place.longitude;
  pose.velocity = nav_.velocity_body;
  pose.altitude = nav_.altitude;
  pose.sigma_horizontal = map_.status.position_sigma;
  pose_ = pose;
  if (publisher_) publisher_->publish(pose);
  (void)live_.recorder().offerMessage(config_.lane, clock_.utcNs(), "FATHOM_POSE", io::encodePose(pose).data);
}

void StatusPublisher::publishSlow() {
  logPassedOver();
  publish(io::encodeMap(mapReport()));
  publish(io::encodeLink(linkReport()));
  publish(io::encodeHealth(health()));
}

// Logs inputs that the mapper skipped and a replay of the log may have.
void StatusPublisher::logPassedOver() {
  const std::uint64_t passed = map_.inputs_passed_over;
  passed_over_reported_ = std::min(passed_over_reported_, passed);  // another mapper counts from 0
  if (passed == passed_over_reported_) return;
  if (log(io::encodeGap({clock_.utcNs(), io::RecordingGap::Kind::kInputs, passed - passed_over_reported_,
                         std::string(io::kGapOfMapper)})))
    passed_over_reported_ = passed;
}

io::MapReport StatusPublisher::mapReport() const {
  io::MapReport report;
  report.utc_ns = map_.utc_ns;
  report.pairs = map_.pairs;
  report.keyframes = map_.keyframes;
  report.closures = map_.closures;
  report.area_m2 = map_.mapped_area;
  report.finest_cell_m = root_size_ / kCellsPerTile / static_cast<double>(1 << max_level_);
  report.coarsest_cell_m = root_size_ / kCellsPerTile;
  report.counts.add({"pairs shed", map_.pairs_shed});
  report.counts.add({"squares coarsened", map_.map_coarsened});
  report.counts.add({"meshes refused", map_.map_refused});
  report.counts.add({"meshes moved", map_.map_meshes_moved});
  return report;
}

io::LinkReport StatusPublisher::linkReport() const {
  io::LinkReport report;
  report.utc_ns = map_.utc_ns;
  report.frames_sent = map_.link_frames;
  report.bytes_sent = map_.link_bytes;
  if (const ModemThread* modem = live_.modem()) {
    const ModemThread::Counters& c = modem->counters();
    report.open = modem->health().open;
    report.frames_received = c.received.load();
    if (const std::int64_t last = c.last_received_ns.load(); last > 0)
      report.heard_ago_s = static_cast<double>(clock_.utcNs() - last) * 1e-9;
    report.counts.add({"frames refused by the modem", c.refused.load()});
    report.counts.add({"frames damaged on the line", c.dropped.load()});
  }
  report.counts.add({"blocks waiting", map_.link_blocks_waiting});
  return report;
}

io::HealthReport StatusPublisher::health() {
  io::HealthReport report;
  report.utc_ns = clock_.utcNs();
  report.soft = !live_.complete();
  report.degradation = static_cast<std::uint8_t>(map_.level);
  report.uptime_s = static_cast<double>(clock_.monotonicNs() - begin_ns_) * 1e-9;
  report.clock_steps = live_.supervisor().clockSteps();
  report.restarts = (live_.resumed() ? 1 : 0) + live_.supervisor().mapperRestarts();
  report.budget_mib = mebibytes(live_.budget().budgetBytes());
  if (rt::ProcessFigures process; process_.read(process)) report.resident_mib = mebibytes(process.resident);
  const rt::SystemFigures system = system_.read();
  if (system.disk_free_bytes) report.disk_free_mib = mebibytes(*system.disk_free_bytes);
  if (system.cpu_temperature_c) report.temperature_c = *system.cpu_temperature_c;
  if (system.load) report.load = *system.load;
  rt::StageTimes::Snapshot stages;
  MapperFigures mapper;
  if (live_.mapper().up().figures.read(mapper))
    for (std::size_t i = 0; i < MapperTier::kStages; ++i)
      addReportedStage(MapperTier::summaryOf(mapper, i), report);
  for (rt::StageTimes* times : {&live_.hardStages(), &live_.recorderStages()})
    if (times->read(stages))
      for (const rt::StageSummary& s : stages.all()) addReportedStage(s, report);
  for (std::size_t i = 0; i < live_.budget().pools(); ++i) {
    const rt::MemoryBudget::Row row = live_.budget().read(i);
    if (row.measured)
      report.fills.add({row.name, static_cast<double>(row.use.used), static_cast<double>(row.use.high_water),
                        static_cast<double>(row.planned), row.use.refused});
  }
  report.fills.add({"map tiles", static_cast<double>(map_.map_tiles),
                    static_cast<double>(map_.map_tiles_high_water),
                    static_cast<double>(live_.config().map.max_tiles), map_.map_refused});
  const io::Recorder::Counters recorded = live_.recorder().counters();
  report.drops.add({"inputs not recorded", recorded.inputs_dropped});
  report.drops.add({"images not recorded: queue", recorded.images_dropped_queue});
  report.drops.add({"images not recorded: disk", recorded.images_dropped_disk});
  report.drops.add({"raw bytes not recorded", recorded.raw_dropped});
  report.drops.add({"pairs shed", map_.pairs_shed});
  report.drops.add({"frames without partner", map_.frames_given_back});
  report.drops.add({"frames not lent to the mapper", live_.framesNotLent()});
  report.drops.add({"inputs skipped by the mapper", map_.inputs_skipped});
  report.drops.add({"rows not written", map_.rows_lost});
  for (const PartReport& part : live_.parts().read())
    report.parts.add({part.name, nameOf(part.state), part.reason});
  for (const NavHealth::Counter& c : nav_.health.counters)
    if (c.value > 0) report.drops.add({c.name, c.value});
  for (const io::DeviceHealth& device : live_.deviceHealth()) {
    io::DeviceReport of;
    of.name = device.name;
    of.open = device.open;
    of.samples = device.samples;
    of.disconnects = device.disconnects;
    if (device.last_data_ns > 0)
      of.silent_s = static_cast<double>(clock_.utcNs() - device.last_data_ns) * 1e-9;
    report.devices.add(of);
  }
  return report;
}

}  // namespace fathom::onboard
