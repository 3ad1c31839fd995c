#include "realtime/onboard/live/watched_threads.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"

namespace fathom::onboard {
namespace {

std::string silent(const char* part, std::int64_t limit_ns) {
  return std::string(part) + " gave no sign of life for " + std::to_string(limit_ns / 1'000'000) + " ms";
}

}  // namespace

std::int64_t ProgramWatch::Life::look(std::int64_t now_ns, std::uint64_t now_beats) {
  if (now_beats != beats || last_ns == 0) last_ns = now_ns;
  beats = now_beats;
  return now_ns - last_ns;
}

std::string ProgramWatch::look(std::int64_t now_ns, std::uint64_t navigation_beats,
                               std::uint64_t supervisor_beats) {
  const std::int64_t navigation_ns = navigation_.look(now_ns, navigation_beats),
                     supervisor_ns = supervisor_.look(now_ns, supervisor_beats);
  alive_ = navigation_ns < config_.navigation_ns;
  if (!alive_) return silent("navigation", config_.navigation_ns);
  if (supervisor_ns >= config_.supervisor_ns) return silent("the supervisor", config_.supervisor_ns);
  return "";
}

namespace {

constexpr std::int64_t kLongest_ns = 600'000'000'000;
constexpr int kMostDoubled = 16;

}  // namespace

HungRestarts::HungRestarts(const std::filesystem::path& state_folder) : file_(state_folder / "hung.txt") {
  if (!(std::ifstream(file_) >> count_)) count_ = 0;
  count_ = std::clamp(count_, 0, kMostDoubled);
}

std::int64_t HungRestarts::patienceNs(std::int64_t limit_ns) const {
  // One limit until it is said that it is stuck, and another.
  return std::max(2 * limit_ns, std::min(limit_ns << (1 + count_), kLongest_ns));
}

bool HungRestarts::note() {
  try {
    writeFile(file_, std::to_string(count_ + 1) + "\n");
  } catch (const std::runtime_error&) {
    return false;
  }
  ++count_;
  return true;
}

bool HungRestarts::waitsForDisk() {
  std::error_code error;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task", error)) {
    std::string line;
    std::getline(std::ifstream(task.path() / "stat"), line);
    // "id (name) state"; a name may hold anything.
    const std::size_t name_end = line.rfind(')');
    if (name_end != std::string::npos && line.compare(name_end, 3, ") D") == 0) return true;
  }
  return false;
}

const char* nameOf(PartState state) {
  constexpr std::array<const char*, 5> kNames = {"starting", "catching up", "running", "failed", "ended"};
  return kNames[static_cast<std::size_t>(state)];
}

bool PartStates::set(std::string_view name, PartState state, std::string reason) {
  const std::lock_guard<std::mutex> lock(mutex_);
  auto part = std::find_if(parts_.begin(), parts_.end(), [&](const auto& p) { return p.name == name; });
  if (part == parts_.end()) part = parts_.insert(parts_.end(), {std::string(name), PartState::kStarting, ""});
  const bool other = part->state != state;
  part->state = state;
  part->reason = std::move(reason);
  return other;
}

std::vector<PartReport> PartStates::read() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return parts_;
}

PartReport PartStates::read(std::string_view name) const {
  for (const PartReport& part : read())
    if (part.name == name) return part;
  return {std::string(name), PartState::kStarting, ""};
}

rt::Heartbeat& WatchedThreads::add(rt::Tier tier, const char* name, const Watch& watch, Body body) {
  const std::size_t watched =
      watchdog_.add({name, std::max(config_.stuck_after_ns, watch.least_ns), watch.restartable});
  rt::Heartbeat& heart = watchdog_.heartbeat(watched);
  workers_.emplace_back(
      rt::threadConfig(config_, tier, name), [&heart, body = std::move(body)] { body(heart); }, watched,
      watch);
  return heart;
}

std::vector<std::string> WatchedThreads::start() {
  std::vector<std::string> missing;
  for (Worker& worker : workers_)
    if (!worker.thread.start(worker.body)) missing.push_back(worker.name);
  return missing;
}

void WatchedThreads::watchFrom(std::int64_t now_ns) {
  for (const Worker& worker : workers_) watchdog_.watch(worker.watched, now_ns);
}

void WatchedThreads::look(std::int64_t now_ns, std::vector<std::string>& events) {
  for (Worker& worker : workers_)
    if (watchdog_.state(worker.watched).watched && worker.kind.restartable && !worker.thread.running() &&
        now_ns >= worker.next_start_ns)
      startAgain(worker, now_ns, events);
  watchdog_.step(now_ns, [&](std::size_t tier, rt::Watchdog::Remedy remedy) {
    const auto of =
        std::find_if(workers_.begin(), workers_.end(), [&](const Worker& w) { return w.watched == tier; });
    if (of == workers_.end()) return;
    if (remedy == rt::Watchdog::Remedy::kRecovered)
      events.push_back(of->name + " is alive again");
    else if (of->thread.running())
      events.push_back(of->name + " is stuck");
    else if (!of->kind.restartable)
      events.push_back(left(*of) + "; going on without it");
  });
}

// One that has given signs of life meanwhile at once, else later each time.
void WatchedThreads::startAgain(Worker& worker, std::int64_t now_ns, std::vector<std::string>& events) {
  constexpr int kMostLeft = 5;
  const std::uint64_t beats = watchdog_.heartbeat(worker.watched).beats();
  worker.left_in_a_row = beats == worker.beats ? std::min(worker.left_in_a_row + 1, kMostLeft) : 0;
  worker.beats = beats;
  worker.next_start_ns = now_ns + (watchdog_.state(worker.watched).spec.limit_ns << worker.left_in_a_row);
  const std::string what = left(worker);
  events.push_back(what +
                   (worker.thread.start(worker.body) ? "; started again" : "; the system gives no thread"));
}

std::string WatchedThreads::left(Worker& worker) {
  if (!worker.thread.failure().empty()) worker.reason = worker.thread.failure();
  return worker.name + " has left" + (worker.thread.failure().empty() ? "" : " (" + worker.reason + ")");
}

std::string WatchedThreads::hanging(const std::function<std::int64_t(std::int64_t)>& patience_ns) const {
  for (const Worker& worker : workers_) {
    const rt::Watchdog::TierState& tier = watchdog_.state(worker.watched);
    if (tier.stuck && worker.thread.running() && tier.silent_ns >= patience_ns(tier.spec.limit_ns))
      return worker.name;
  }
  return "";
}

std::string WatchedThreads::reasonOf(std::string_view name) const {
  const auto of =
      std::find_if(workers_.begin(), workers_.end(), [&](const Worker& w) { return w.name == name; });
  if (of == workers_.end()) return "";
  return of->thread.running() || of->thread.failure().empty() ? of->reason : of->thread.failure();
}

void WatchedThreads::unwatch() {
  for (const Worker& worker : workers_) watchdog_.unwatch(worker.watched);
}

std::vector<std::string> WatchedThreads::join(const std::function<bool()>& more_time) {
  constexpr std::int64_t kLook_ns = 2'000'000;
  std::vector<std::string> still;
  for (Worker& worker : workers_) {
    const std::int64_t most_ns =
        worker.kind.waits_for_disk ? INT64_MAX : watchdog_.state(worker.watched).spec.limit_ns;
    for (std::int64_t waited_ns = 0; worker.thread.running() && more_time(); waited_ns += kLook_ns) {
      if (waited_ns >= most_ns) break;
      rt::restFor(kLook_ns);
    }
    if (worker.thread.running())
      still.push_back(worker.name);
    else
      worker.thread.join();
  }
  return still;
}

std::size_t WatchedThreads::stackBytes() const {
  std::size_t bytes = 0;
  for (const Worker& worker : workers_) bytes += worker.thread.stackBytes();
  return bytes;
}

}  // namespace fathom::onboard
