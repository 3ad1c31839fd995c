#include "firmware_if/recorder/recorder.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <exception>
#include <mutex>
#include <type_traits>
#include <utility>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/recorder/image_stage.hpp"
#include "firmware_if/recorder/log_stage.hpp"
#include "firmware_if/recorder/recording_folder.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kDiskLookInterval_ns = 200 * kMillisecond_ns;

// A record of 8 byte numbers that one thread publishes and any thread reads. Each number is whole; a reader
// may see some of the newest and some of those before.
template <class Record>
class SharedWords {
  static_assert(std::is_trivially_copyable_v<Record> && sizeof(Record) % sizeof(std::uint64_t) == 0);
  static constexpr std::size_t kWords = sizeof(Record) / sizeof(std::uint64_t);

 public:
  void publish(const Record& record) noexcept {
    std::array<std::uint64_t, kWords> words;
    std::memcpy(words.data(), &record, sizeof record);
    for (std::size_t i = 0; i < kWords; ++i) words_[i].store(words[i], std::memory_order_relaxed);
  }
  [[nodiscard]] Record read() const noexcept {
    std::array<std::uint64_t, kWords> words;
    for (std::size_t i = 0; i < kWords; ++i) words[i] = words_[i].load(std::memory_order_relaxed);
    Record record;
    std::memcpy(static_cast<void*>(&record), words.data(), sizeof record);
    return record;
  }

 private:
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

}  // namespace

struct Recorder::Impl {
  Impl(const std::filesystem::path& path, const MissionConfig& mission, const StereoRig& rig,
       const RecorderConfig& config, ViewOf view, Release give_back)
      : paths(path),
        folder(path, mission, rig, config),
        images(paths.images(), config.image_queue, std::move(view), std::move(give_back)),
        log(config, folder.log(), images),
        guard(config.image_reserve_mib, config.log_reserve_mib) {
    if (folder.open(clock.monotonicNs())) publishFound();
    lookAtDisk(clock.monotonicNs());
    publish(State::kStarting);
  }

  bool work(int budget_ms);
  CloseResult close(double most_s);

  void openFolder();
  void publishFound();
  void publish(State when_well);
  void lookAtDisk(std::int64_t now);
  [[nodiscard]] Disk level() const;
  [[nodiscard]] std::string whatTheDiskRefuses() const;
  [[nodiscard]] bool waiting() { return log.waiting() || images.waiting(); }

  rt::RealClock clock;
  MissionPaths paths;
  RecordingFolder folder;
  ImageStage images;
  LogStage log;
  DiskGuard guard;
  std::uint64_t first_position = 0;
  std::int64_t next_disk_look_ns = 0;

  SharedWords<Counters> published;
  SharedWords<Found> found;
  std::atomic<Disk> disk{Disk::kRoom};
  std::atomic<double> free_mib{0};
  std::atomic<State> state{State::kStarting};
  std::mutex failure_mutex;
  std::string failure;
};

Recorder::Recorder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
                   const RecorderConfig& config, ViewOf view_of, Release release)
    : impl_(std::make_unique<Impl>(folder, mission, rig, config, std::move(view_of), std::move(release))) {}

Recorder::~Recorder() = default;

void Recorder::setFirstPosition(std::uint64_t position) noexcept {
  impl_->first_position = position;
  Counters c = impl_->published.read();
  c.safe_position = position;
  impl_->published.publish(c);
}

bool Recorder::offerInput(const OnboardInput& input) noexcept {
  return impl_->log.inputs().offer(input);
}

bool Recorder::offerDecision(const OnboardInput& input) noexcept {
  return impl_->log.decisions().offer(input);
}

bool Recorder::offerImage(const CameraFrame& frame) noexcept {
  return impl_->images.offer(frame);
}

bool Recorder::offerRaw(std::size_t lane, std::int64_t arrival_utc_ns, std::string_view source,
                        std::span<const std::uint8_t> bytes) noexcept {
  RawLane* raw = impl_->log.raw(lane);
  return raw != nullptr && raw->offer({RawLane::Kind::kRaw, arrival_utc_ns, source, bytes});
}

bool Recorder::offerMessage(std::size_t lane, std::int64_t utc_ns, std::string_view channel,
                            std::span<const std::uint8_t> data) noexcept {
  RawLane* raw = impl_->log.raw(lane);
  return raw != nullptr && raw->offer({RawLane::Kind::kMessage, utc_ns, channel, data});
}

bool Recorder::work(int budget_ms) {
  return impl_->work(budget_ms);
}

Recorder::CloseResult Recorder::close(double most_s) {
  return impl_->close(most_s);
}

Recorder::Found Recorder::found() const noexcept {
  return impl_->found.read();
}

Recorder::Counters Recorder::counters() const noexcept {
  Counters c = impl_->published.read();
  c.inputs_dropped = impl_->log.inputs().refused();
  c.decisions_dropped = impl_->log.decisions().refused();
  c.input_high_water = impl_->log.inputs().highWater();
  c.raw_dropped += impl_->log.rawRefused();
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

Recorder::State Recorder::state() const noexcept {
  return impl_->state.load(std::memory_order_acquire);
}

std::string Recorder::failure() const {
  const std::lock_guard lock(impl_->failure_mutex);
  return impl_->failure;
}

bool Recorder::Impl::work(int budget_ms) {
  const std::int64_t deadline = clock.monotonicNs() + budget_ms * kMillisecond_ns;
  bool more = false;
  do {
    lookAtDisk(clock.monotonicNs());
    openFolder();
    const std::uint64_t before = log.counters().inputs;
    log.drain(deadline, level() < Disk::kRawStopped, folder.mission().vehicle_name);
    log.handOver();
    const bool images_wait = images.waiting();
    images.step(level() == Disk::kRoom);
    more = waiting();
    // While the disk refuses the log, nothing moves on by trying again at once.
    if (more && !images_wait && log.counters().inputs == before && log.refuses()) break;
  } while (more && clock.monotonicNs() < deadline);
  publish(State::kRunning);
  return more;
}

Recorder::CloseResult Recorder::Impl::close(double most_s) {
  constexpr std::int64_t kPause = 20 * kMillisecond_ns, kLongestStep = 1000 * kMillisecond_ns;
  const std::int64_t deadline = clock.monotonicNs() + static_cast<std::int64_t>(most_s * 1e9);
  CloseResult result;
  for (;;) {
    const std::int64_t left = std::clamp(deadline - clock.monotonicNs(), std::int64_t{0}, kLongestStep);
    result.log_whole = !work(static_cast<int>(left / kMillisecond_ns)) && log.end();
    if (result.log_whole || clock.monotonicNs() >= deadline) break;
    if (!log.refuses()) continue;
    folder.hurry();
    clock.sleepUntil(std::min(clock.monotonicNs() + kPause, deadline));
  }
  while (images.waiting()) images.step(false);
  publish(State::kEnded);
  const std::uint64_t inputs =
      log.inputs().missingAtEnd() + log.inputs().next() - log.counters().inputs_passed;
  if (!folder.isOpen()) {
    result.text = "nothing of this run was recorded, the disk refuses (" + folder.failure() + ")";
  } else {
    if (!result.log_whole)
      result.text = std::to_string(inputs) + " inputs are not on the disk for certain, " +
                    (log.refuses() ? "it refuses (" + folder.log().failure() + ")" : "the time was over");
    folder.log().close();
  }
  std::string why = "the time was over";
  try {
    const auto in_time = [&] { return clock.monotonicNs() < deadline; };
    result.raw_auv = in_time() && deriveRawAuv(paths.root, in_time);
  } catch (const std::exception& e) {
    why = e.what();
  }
  if (!result.raw_auv) result.text += (result.text.empty() ? "" : "; ") + ("no RAW.auv was written: " + why);
  return result;
}

// An operator's mistake that the constructor could not find, because the disk did not answer, does not end
// the run.
void Recorder::Impl::openFolder() {
  if (folder.isOpen()) return;
  try {
    if (folder.open(clock.monotonicNs())) publishFound();
  } catch (const InputError&) {
  }
}

void Recorder::Impl::publishFound() {
  found.publish({folder.log().wholeAtStart(), folder.log().cutAtStart(), folder.found().without_event,
                 folder.found().halves_removed});
}

std::string Recorder::Impl::whatTheDiskRefuses() const {
  if (!folder.isOpen()) return folder.failure();
  if (log.refuses()) return paths.log().filename().string() + ": " + folder.log().failure();
  if (images.error() != 0)
    return paths.images().filename().string() + ": cannot be written (" + std::strerror(images.error()) + ")";
  return "";
}

void Recorder::Impl::publish(State when_well) {
  const ImageStage::Counters& of_images = images.counters();
  const LogStage::Counters& of_log = log.counters();
  Counters all;
  all.inputs = of_log.inputs;
  all.decisions = of_log.decisions;
  all.raw_entries = of_log.raw_entries;
  all.messages = of_log.messages;
  all.inputs_safe = of_log.inputs_safe;
  all.safe_position = first_position + of_log.inputs_passed;
  all.decisions_safe = of_log.decisions_passed;
  all.syncs = of_log.syncs;
  all.syncs_failed = of_log.syncs_failed;
  all.raw_dropped = of_log.raw_dropped;
  all.worst_sync_ns = of_log.worst_sync_ns;
  all.worst_unsafe_ns = of_log.worst_unsafe_ns;
  all.images = of_images.written;
  all.images_dropped_queue = of_images.dropped_slow;
  all.images_dropped_disk = of_images.dropped_disk;
  all.images_without_input = of_images.without_input;
  all.write_failures = of_log.write_failures + of_images.failures;
  all.open_failures = folder.refusals();
  all.bytes = folder.log().size() - folder.log().wholeAtStart() + images.bytes();
  published.publish(all);
  disk.store(level(), std::memory_order_relaxed);
  std::string refused = whatTheDiskRefuses();
  const bool failed = !refused.empty();
  {
    const std::lock_guard lock(failure_mutex);
    failure = std::move(refused);
  }
  state.store(failed && when_well != State::kEnded ? State::kFailed : when_well, std::memory_order_release);
}

void Recorder::Impl::lookAtDisk(std::int64_t now) {
  if (now < next_disk_look_ns) return;
  next_disk_look_ns = now + kDiskLookInterval_ns;
  const double free = static_cast<double>(freeBytes(paths.root)) / kMebibyte;
  guard.update(free);
  free_mib.store(free, std::memory_order_relaxed);
}

Recorder::Disk Recorder::Impl::level() const {
  if (log.refuses()) return Disk::kFull;
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

}  // namespace fathom::io
