#include "firmware_if/recorder/recorder.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission_folder.hpp"
#include "firmware_if/log/recording_gap.hpp"
#include "firmware_if/recorder/disk_guard.hpp"
#include "firmware_if/recorder/found_recording.hpp"
#include "firmware_if/recorder/image_stage.hpp"
#include "firmware_if/recorder/input_lane.hpp"
#include "firmware_if/recorder/journal_file.hpp"
#include "firmware_if/recorder/raw_lane.hpp"
#include "firmware_if/recorder/shared_words.hpp"
#include "realtime/kernel/clock.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr double kMiB = 1024.0 * 1024.0;
constexpr std::int64_t kMillisecond = 1'000'000;  // [ns]
constexpr std::int64_t kNanosecondsPerMicrosecond = 1000;
constexpr std::int64_t kDiskLookInterval = 200 * kMillisecond;
// An input with its ACFR twin and two gaps before it.
constexpr std::size_t kMostInputBytes = 4096;
constexpr std::size_t kSpareToSync = std::size_t{3} << 20;  // of the journal's memory
constexpr std::size_t kMostFramingBytes = 256;              // of an event around its data

void syncFile(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  (void)::fsync(fd);
  ::close(fd);
}

// The disk must hold the mission's files, and their names, before it holds its data. Not all that waits for
// the disk: after a crash that may be much, and has time.
void syncMission(const MissionPaths& paths) {
  for (const auto& path : {paths.root / "mission.toml", paths.calib(), paths.images(), paths.root,
                           std::filesystem::absolute(paths.root).parent_path()})
    syncFile(path);
}

std::uint64_t mebibytes(double mib) {
  return static_cast<std::uint64_t>(mib * kMiB);
}

}  // namespace

struct Recorder::Impl {
  Impl(const std::filesystem::path& folder, const MissionConfig& given, const StereoRig& rig,
       const RecorderConfig& configuration, ViewOf view, Release give_back)
      : paths(folder),
        config(configuration),
        mission(prepareMissionFolder(folder, given, rig)),
        journal(paths.log(), plannedBytes(config, mission, rig).log, mebibytes(config.log_reserve_mib)),
        images(paths.images(), config.image_queue, std::move(view), std::move(give_back)),
        guard(config.image_reserve_mib, config.log_reserve_mib) {
    for (std::size_t i = 0; i < config.raw_lanes; ++i)
      raw.push_back(std::make_unique<RawLane>(config.raw_queue_kib * 1024));
    const FoundImages left = lookAtImages(paths);
    found = {journal.wholeAtStart(), journal.cutAtStart(), left.without_event, left.halves_removed};
    syncMission(paths);
    lookAtDisk(clock.monotonicNs());
  }

  bool work(int budget_ms);
  void close();

  void publish();
  void lookAtDisk(std::int64_t now);
  [[nodiscard]] Disk level() const;
  void drain(std::int64_t deadline);
  [[nodiscard]] bool logInput(InputLane& lane, std::uint64_t& written);
  [[nodiscard]] bool logRaw(RawLane& lane, const RawLane::Entry& entry);
  void logGap(const RecordingGap& gap);
  void append(std::int64_t arrival_utc_ns, const LogMessage& message, std::int64_t offered_ns);
  void handOver();
  void syncIfDue();
  void sync();
  [[nodiscard]] bool waiting();

  rt::RealClock clock;
  MissionPaths paths;
  RecorderConfig config;
  MissionConfig mission;
  JournalFile journal;
  ImageStage images;
  DiskGuard guard;
  Found found;

  InputLane inputs, decisions;
  std::vector<std::unique_ptr<RawLane>> raw;

  // The recorder's thread only.
  Counters counters;
  std::uint64_t raw_refused_logged = 0, raw_dropped_by_rule = 0;
  std::int64_t next_disk_look_ns = 0;
  // When the oldest entry was offered that the disk does not hold; 0: none.
  std::int64_t oldest_unsafe_ns = 0;
  bool refuses = false;      // the disk refused the last write or sync of the log
  bool names_image = false;  // an event that waits for the next sync names an image
  bool blocked = false;      // the next input names an exposure that is not written yet

  SharedWords<Counters> published;
  std::atomic<Disk> disk{Disk::kRoom};
  std::atomic<double> free_mib{0};
};

Recorder::Recorder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
                   const RecorderConfig& config, ViewOf view_of, Release release)
    : impl_(std::make_unique<Impl>(folder, mission, rig, config, std::move(view_of), std::move(release))) {}

Recorder::~Recorder() = default;

bool Recorder::offerInput(const OnboardInput& input) noexcept {
  return impl_->inputs.offer(input);
}

bool Recorder::offerDecision(const OnboardInput& input) noexcept {
  return impl_->decisions.offer(input);
}

bool Recorder::offerImage(const CameraFrame& frame) noexcept {
  return impl_->images.offer(frame);
}

bool Recorder::offerRaw(std::size_t lane, std::int64_t arrival_utc_ns, std::string_view source,
                        std::span<const std::uint8_t> bytes) noexcept {
  return lane < impl_->raw.size() &&
         impl_->raw[lane]->offer({RawLane::Kind::kRaw, arrival_utc_ns, source, bytes});
}

bool Recorder::offerMessage(std::size_t lane, std::int64_t utc_ns, std::string_view channel,
                            std::span<const std::uint8_t> data) noexcept {
  return lane < impl_->raw.size() &&
         impl_->raw[lane]->offer({RawLane::Kind::kMessage, utc_ns, channel, data});
}

bool Recorder::work(int budget_ms) {
  return impl_->work(budget_ms);
}

void Recorder::close() {
  impl_->close();
}

const Recorder::Found& Recorder::found() const noexcept {
  return impl_->found;
}

Recorder::Counters Recorder::counters() const noexcept {
  Counters c = impl_->published.read();
  c.inputs_dropped = impl_->inputs.refused();
  c.decisions_dropped = impl_->decisions.refused();
  c.input_high_water = impl_->inputs.highWater();
  for (const auto& lane : impl_->raw) c.raw_dropped += lane->refused();
  c.images_dropped_queue += impl_->images.refused();
  c.image_high_water = impl_->images.highWater();
  return c;
}

Recorder::Disk Recorder::disk() const noexcept {
  return impl_->disk.load(std::memory_order_relaxed);
}

double Recorder::diskFreeMib() const noexcept {
  return impl_->free_mib.load(std::memory_order_relaxed);
}

bool Recorder::Impl::work(int budget_ms) {
  const std::int64_t deadline = clock.monotonicNs() + budget_ms * kMillisecond;
  bool more = false;
  do {
    lookAtDisk(clock.monotonicNs());
    const std::uint64_t before = counters.inputs;
    drain(deadline);
    handOver();
    syncIfDue();
    const bool images_wait = images.waiting();
    images.step(level() == Disk::kRoom);
    more = waiting();
    // While the disk refuses the log, nothing moves on by trying again at once.
    if (more && !images_wait && counters.inputs == before && refuses) break;
  } while (more && clock.monotonicNs() < deadline);
  disk.store(level(), std::memory_order_relaxed);
  publish();
  return more;
}

void Recorder::Impl::close() {
  while (work(1000))
    if (refuses) break;
  sync();
  publish();
  journal.close();
  if (!journal.safe()) throw std::runtime_error("the disk refuses the end of " + paths.log().string());
  try {
    deriveRawAuv(paths.root);
  } catch (const InputError&) {
    // A log without a sample of navigation has no RAW.auv.
  }
}

void Recorder::Impl::publish() {
  const ImageStage::Counters& of_images = images.counters();
  Counters all = counters;
  all.images = of_images.written;
  all.images_dropped_queue = of_images.dropped_slow;
  all.images_dropped_disk = of_images.dropped_disk;
  all.images_without_input = of_images.without_input;
  all.write_failures += of_images.failures;
  all.bytes = journal.size() - journal.wholeAtStart() + images.bytes();
  published.publish(all);
}

void Recorder::Impl::lookAtDisk(std::int64_t now) {
  if (now < next_disk_look_ns) return;
  next_disk_look_ns = now + kDiskLookInterval;
  const double free = static_cast<double>(freeBytes(paths.root)) / kMiB;
  guard.update(free);
  free_mib.store(free, std::memory_order_relaxed);
}

Recorder::Disk Recorder::Impl::level() const {
  if (refuses) return Disk::kFull;
  switch (guard.level()) {
    case DiskGuard::Level::kRoom:
      return Disk::kRoom;
    case DiskGuard::Level::kImagesStopped:
      return Disk::kImagesStopped;
    case DiskGuard::Level::kRawStopped:
      break;
  }
  return Disk::kRawStopped;
}

bool Recorder::Impl::waiting() {
  RawLane::Entry entry;
  bool any = inputs.front() != nullptr || decisions.front() != nullptr || images.waiting();
  for (const auto& lane : raw) any = any || lane->front(entry);
  return any;
}

// Moves what waits into the journal, by arrival, each lane in its own order, until an input names an exposure
// that is not written yet, the journal's memory is full, or the time is over.
void Recorder::Impl::drain(std::int64_t deadline) {
  constexpr int kEntriesBetweenLooks = 64;
  blocked = false;
  for (int count = 1; !blocked; ++count) {
    if (count % kEntriesBetweenLooks == 0 && clock.monotonicNs() >= deadline) return;
    InputLane* first = nullptr;
    RawLane* first_raw = nullptr;
    RawLane::Entry entry, first_entry;
    std::int64_t first_utc_ns = 0;
    for (InputLane* lane : {&inputs, &decisions}) {
      const InputLane::Entry* front = lane->front();
      if (front == nullptr || (first != nullptr && front->input.arrival_utc_ns >= first_utc_ns)) continue;
      first = lane;
      first_utc_ns = front->input.arrival_utc_ns;
    }
    for (const auto& lane : raw) {
      if (!lane->front(entry)) continue;
      if ((first != nullptr || first_raw != nullptr) && entry.arrival_utc_ns > first_utc_ns) continue;
      first_raw = lane.get();
      first_entry = entry;
      first_utc_ns = entry.arrival_utc_ns;
    }
    if (first_raw != nullptr) {
      if (!logRaw(*first_raw, first_entry)) return;
    } else if (first == nullptr ||
               !logInput(*first, first == &inputs ? counters.inputs : counters.decisions)) {
      return;
    }
  }
}

bool Recorder::Impl::logInput(InputLane& lane, std::uint64_t& written) {
  if (journal.spare() < kMostInputBytes) return false;
  const InputLane::Entry& entry = *lane.front();
  const std::int64_t arrival = entry.input.arrival_utc_ns;
  const ImageEvent* image = imageOf(entry.input);
  std::optional<RecordingGap> image_gap;
  if (image != nullptr) {
    const ImageLane::State state = images.stateOf(image->side, image->utc_ns);
    if (state == ImageLane::State::kWaiting) {
      blocked = true;
      return false;
    }
    if (state == ImageLane::State::kLost)
      image_gap = {arrival, RecordingGap::Kind::kImage, 1, image->file_name};
    images.named(image->side, image->utc_ns);
    names_image = names_image || state == ImageLane::State::kWritten;
  }
  const std::uint64_t missing = lane.missingBeforeFront();
  if (missing > 0) logGap({arrival, RecordingGap::Kind::kInputs, missing, ""});
  if (image_gap) logGap(*image_gap);
  append(arrival, encodeInput(entry.input), entry.offered_ns);
  if (config.acfr_channels)
    if (const auto* sample = std::get_if<SensorSample>(&entry.input.what))
      if (const auto twin = encodeAcfrTwin(*sample, mission.vehicle_name))
        append(arrival, *twin, entry.offered_ns);
  lane.pop();
  ++written;
  return true;
}

bool Recorder::Impl::logRaw(RawLane& lane, const RawLane::Entry& entry) {
  if (level() >= Disk::kRawStopped) {
    ++raw_dropped_by_rule;
    ++counters.raw_dropped;
    lane.pop();
    return true;
  }
  std::uint64_t refused = raw_dropped_by_rule;
  for (const auto& each : raw) refused += each->refused();
  if (journal.spare() < entry.data.size() + kMostInputBytes + kMostFramingBytes) return false;
  if (refused > raw_refused_logged)
    logGap({entry.arrival_utc_ns, RecordingGap::Kind::kRaw, refused - raw_refused_logged, ""});
  raw_refused_logged = refused;
  const std::int64_t now = clock.monotonicNs();
  if (entry.kind == RawLane::Kind::kRaw) {
    append(entry.arrival_utc_ns, {std::string(entry.channel), encodeRaw(entry.arrival_utc_ns, entry.data)},
           now);
    ++counters.raw_entries;
  } else {
    append(entry.arrival_utc_ns,
           {std::string(entry.channel), std::vector<std::uint8_t>(entry.data.begin(), entry.data.end())},
           now);
    ++counters.messages;
  }
  lane.pop();
  return true;
}

void Recorder::Impl::logGap(const RecordingGap& gap) {
  append(gap.arrival_utc_ns, encodeGap(gap), clock.monotonicNs());
}

void Recorder::Impl::append(std::int64_t arrival_utc_ns, const LogMessage& message, std::int64_t offered_ns) {
  journal.append(arrival_utc_ns / kNanosecondsPerMicrosecond, message.channel, message.data);
  if (oldest_unsafe_ns == 0) oldest_unsafe_ns = offered_ns;
}

void Recorder::Impl::handOver() {
  const bool good = journal.write();
  if (!good) ++counters.write_failures;
  refuses = !good;
}

void Recorder::Impl::syncIfDue() {
  if (oldest_unsafe_ns == 0) return;
  // Images go first only when the log can wait for them; once they are on the disk, so is soon what names
  // them.
  const bool images_wait = images.waiting();
  const std::int64_t age = clock.monotonicNs() + (images_wait ? images.timeNs() : 0) - oldest_unsafe_ns;
  const bool named = names_image && !images_wait;
  if (named || journal.spare() < kSpareToSync ||
      age >= static_cast<std::int64_t>(config.sync_interval_s * 1e9))
    sync();
}

void Recorder::Impl::sync() {
  const std::int64_t start = clock.monotonicNs();
  const bool good = journal.sync();
  const std::int64_t end = clock.monotonicNs();
  ++counters.syncs;
  counters.worst_sync_ns = std::max(counters.worst_sync_ns, end - start);
  if (!good) {
    ++counters.write_failures;
    refuses = true;
  }
  if (!good || !journal.safe()) return;
  counters.inputs_safe = counters.inputs;
  if (oldest_unsafe_ns != 0)
    counters.worst_unsafe_ns = std::max(counters.worst_unsafe_ns, end - oldest_unsafe_ns);
  oldest_unsafe_ns = 0;
  names_image = false;
}

}  // namespace fathom::io
