#include "realtime/onboard/mission_run.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <thread>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::onboard {
namespace {

// Frames received at one time: bounded, so that a flooded modem cannot stop the vehicle.
constexpr int kMostReceived = 64;
// A dive of a day at ten frames a second; more is no recording of a downlink.
constexpr std::size_t kMostRecorded = 864000;

std::vector<telemetry::Packet> readRecording(const std::filesystem::path& path) {
  telemetry::PacketLogReader reader(path);
  std::vector<telemetry::Packet> packets;
  while (auto packet = reader.next()) {
    const std::string place = "frame " + std::to_string(packets.size());
    if (packets.size() == kMostRecorded)
      throw InputError(path.string(), place, "more frames than a dive receives; give a downlink.bin");
    if (!packets.empty() && packet->utc_ns < packets.back().utc_ns)
      throw InputError(path.string(), place,
                       "is older than the one before it; give an unchanged downlink.bin");
    packets.push_back(std::move(*packet));
  }
  return packets;
}

using Clock = std::chrono::steady_clock;
using rt::milliseconds;
using rt::secondsSince;

nlohmann::ordered_json reportOf(const RunSummary& summary, std::uint64_t damaged_entries,
                                const OnboardSystem& system, const io::MissionConfig& mission) {
  nlohmann::ordered_json report;
  report["vehicle"] = mission.vehicle_name;
  report["dive_id"] = mission.dive_id;
  report["mission_s"] = summary.mission_s;
  report["samples"] = summary.samples;
  report["damaged_entries"] = damaged_entries;
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

}  // namespace

FrameExchange::FrameExchange(OnboardOutput& output, const FrameExchangeOptions& options)
    : output_(output), options_(options) {
  if (options_.downlink) recorded_ = readRecording(*options_.downlink);
}

void FrameExchange::pace(std::int64_t now_ns) const {
  if (options_.modem == nullptr || options_.speed <= 0) return;
  const double due = static_cast<double>(now_ns - first_ns_) / kNanosecondsPerSecond / options_.speed;
  std::this_thread::sleep_until(
      start_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(due)));
}

void FrameExchange::receive(OnboardSystem& system, std::int64_t now_ns, std::span<const std::uint8_t> frame) {
  output_.addDownlink(now_ns, frame);
  ++counters_.received;
  system.receiveFrame(now_ns, frame);
}

void FrameExchange::receiveAll(OnboardSystem& system, std::int64_t now_ns) {
  if (options_.downlink) {
    for (; next_recorded_ < recorded_.size() && recorded_[next_recorded_].utc_ns <= now_ns; ++next_recorded_)
      receive(system, now_ns, recorded_[next_recorded_].bytes);
    return;
  }
  if (options_.modem == nullptr) return;
  for (int i = 0; i < kMostReceived; ++i) {
    const std::size_t size = options_.modem->receive(buffer_);
    if (size == 0) return;
    telemetry::LinkFrames frames(std::span<const std::uint8_t>(buffer_).first(size));
    while (const auto frame = frames.next()) receive(system, now_ns, *frame);
  }
}

void FrameExchange::exchange(OnboardSystem& system, std::int64_t now_ns, bool survey_over) {
  if (!received_at_ns_) {
    first_ns_ = now_ns;
    start_ = Clock::now();
  }
  if (!received_at_ns_ || now_ns > *received_at_ns_) {
    received_at_ns_ = now_ns;
    pace(now_ns);
    if (options_.modem_clock) options_.modem_clock(now_ns);
    receiveAll(system, now_ns);
  }
  while (const std::size_t size = system.nextFrame(now_ns, survey_over, buffer_)) {
    const std::span<const std::uint8_t> frame(buffer_.data(), size);
    output_.addPacket(now_ns, frame);
    ++counters_.sent;
    counters_.sent_bytes += size;
    if (options_.modem != nullptr && !options_.modem->send(frame)) ++counters_.refused;
  }
}

MissionRun::MissionRun(Setup setup, OnboardOutput& output)
    : setup_(std::move(setup)),
      output_(output),
      system_(setup_.config, setup_.mission, setup_.rig, setup_.pairs, setup_.slots),
      link_(output, setup_.link) {
  // One tier, one thread: OpenCV's own would run at no stated priority, and share sums out differently.
  cv::setNumThreads(0);
  system_.setStageObserver([this](const char* stage) {
    stages_.ended(stage);
    if (on_stage_) on_stage_(stage);
  });
  system_.setRetiredObserver(
      [this](const slam::NavigationGraph::Retired& gone) { output_.addRetired(gone); });
}

void MissionRun::setObservers(std::function<void(const char* stage)> on_stage, OnboardSystem::OnPair on_seen,
                              OnboardSystem::OnPair on_pair) {
  on_stage_ = std::move(on_stage);
  system_.setSeenObserver(std::move(on_seen));
  on_pair_ = std::move(on_pair);
}

void MissionRun::begin(std::int64_t now_ns) {
  begun_ = true;
  first_ns_ = next_odometry_ns_ = next_health_ns_ = now_ns;
}

void MissionRun::consumeSample(std::int64_t now_ns, const SensorSample& sample) {
  const auto before = Clock::now();
  stages_.begin();
  const double read_before = reading();
  system_.consume(now_ns, sample, [this](const auto& pair) { notePlaced(pair); });
  const double core_s = secondsSince(before) - (reading() - read_before);
  summary_.stereo_and_map_s += core_s;
  stages_.endSample(core_s);
  ++summary_.samples;
}

void MissionRun::notePlaced(const OnboardSystem::MappedPair& pair) {
  output_.addStereoPose(pair.output, pair.left_image, pair.right_image, pair.altitude.value_or(0.0));
  if (pair.output.points > 0) ++summary_.pairs_used;
  ++summary_.pairs;
  if (on_pair_) on_pair_(pair);
}

void MissionRun::consumeMark(const io::Mark& mark) {
  if (mark.kind == io::Mark::Kind::kEnd) ended_ = true;
  if (mark.kind == io::Mark::Kind::kMapperLost) link_silent_ = true;
  if (mark.kind == io::Mark::Kind::kSent)
    system_.noteSent(static_cast<telemetry::Version>(mark.number), now_ns_);
  if (mark.kind == io::Mark::Kind::kRestart) {
    link_silent_ = false;
    system_.noteRestart();
  }
  if (mark.kind == io::Mark::Kind::kCheckpoint)
    eachSlotStore([&](SlotStore& slots) { slots.mark(mark.number); });
  if (mark.kind == io::Mark::Kind::kHealth)
    system_.setProgramHealth(static_cast<unsigned>(mark.number & 0xFFFFU),
                             static_cast<std::uint32_t>(mark.number >> 16U));
}

void MissionRun::consume(const io::OnboardInput& input) {
  if (std::holds_alternative<io::Decision>(input.what)) return;
  ++inputs_;
  const std::int64_t now_ns = input.arrival_utc_ns;
  if (!begun_) begin(now_ns);
  now_ns_ = now_ns;
  if (const auto* sample = std::get_if<SensorSample>(&input.what)) {
    consumeSample(now_ns, *sample);
  } else if (const auto* frame = std::get_if<io::ModemFrame>(&input.what)) {
    link_.receive(system_, now_ns, frame->data());
  } else if (const auto* mark = std::get_if<io::Mark>(&input.what)) {
    consumeMark(*mark);
    return;
  } else {
    system_.passTime(now_ns);
  }
  writeRows(now_ns);
  if (!link_silent_) link_.exchange(system_, now_ns, false);
}

void MissionRun::writeRows(std::int64_t now_ns) {
  if (now_ns >= next_odometry_ns_) {
    const nav::DeadReckoning& odometry = system_.nav().odometry();
    const std::int64_t newest = odometry.newestUtcNs();
    const auto pose = newest > last_odometry_ns_ ? odometry.poseAt(newest) : std::nullopt;
    if (pose) output_.addOdometry(newest, *pose);
    last_odometry_ns_ = std::max(last_odometry_ns_, newest);
    next_odometry_ns_ =
        now_ns + static_cast<std::int64_t>(setup_.config.odometry_interval * kNanosecondsPerSecond);
  }
  if (now_ns < next_health_ns_) return;
  output_.addHealth(now_ns, system_.health());
  next_health_ns_ = now_ns + static_cast<std::int64_t>(setup_.config.health_interval * kNanosecondsPerSecond);
}

void MissionRun::finish(double drain_s) {
  const auto before = Clock::now();
  system_.finish(now_ns_, [this](const auto& pair) { notePlaced(pair); });
  finish_s_ = secondsSince(before);
  constexpr std::int64_t kDrainStep = 100'000'000;  // [ns]
  const std::int64_t drain_end = now_ns_ + static_cast<std::int64_t>(drain_s * kNanosecondsPerSecond);
  for (std::int64_t now = now_ns_; now <= drain_end; now += kDrainStep) {
    link_.exchange(system_, now, true);
    if (system_.link().drained()) break;
  }
}

RunSummary MissionRun::summary() const {
  RunSummary s = summary_;
  s.mission_s = static_cast<double>(now_ns_ - first_ns_) / kNanosecondsPerSecond;
  s.frames = link_.counters().sent;
  s.frame_bytes = link_.counters().sent_bytes;
  s.frames_received = link_.counters().received;
  s.mapped_area = system_.link().mappedArea();
  s.unreadable_images = system_.unreadableImages();
  s.warning = system_.map().rig().warning().value_or("");
  return s;
}

bool MissionRun::write(std::uint64_t damaged_entries, double wall_s) {
  const Mesh map = system_.mapMesh();
  if (map.empty()) return false;
  output_.writeMap(map);
  output_.placeStereoPoses([this](const MapOutput& pair) { return system_.map().poseOf(pair); });
  if (const LocalisationCore* localisation = system_.map().localisation())
    output_.writeClosures(*localisation);
  const RunSummary s = summary();
  output_.writeText("report.json", reportOf(s, damaged_entries, system_, setup_.mission).dump(2) + "\n");
  nlohmann::ordered_json timing;
  timing["wall_s"] = wall_s;
  timing["image_reading_s"] = reading();
  timing["cores_s"] = s.stereo_and_map_s;
  timing["cores_ms_per_pair"] = s.pairs ? 1e3 * s.stereo_and_map_s / static_cast<double>(s.pairs) : 0.0;
  timing["finish_s"] = finish_s_;
  for (const auto& [name, times] : stages_.stages())
    timing["stages_ms"][name] = {{"frames", times.count()},
                                 {"p50", milliseconds(times.percentile(50))},
                                 {"p99", milliseconds(times.percentile(99))},
                                 {"p99_9", milliseconds(times.percentile(99.9))},
                                 {"max", milliseconds(times.max())}};
  timing["modem_refused_frames"] = link_.counters().refused;
  output_.writeText("timing.json", timing.dump(2) + "\n");
  return true;
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
