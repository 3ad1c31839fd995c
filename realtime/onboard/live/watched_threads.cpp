#include "realtime/onboard/live/watched_threads.hpp"

#include <algorithm>

namespace fathom::onboard {

rt::Heartbeat& WatchedThreads::add(rt::Tier tier, const char* name, const Watch& watch, Body body) {
  const std::size_t watched =
      watchdog_.add({name, std::max(config_.stuck_after_ns, watch.least_ns), watch.restartable, watch.vital});
  rt::Heartbeat& heart = watchdog_.heartbeat(watched);
  workers_.emplace_back(
      rt::threadConfig(config_, tier, name), [&heart, body = std::move(body)] { body(heart); }, watched);
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
  watchdog_.step(now_ns, [&](std::size_t tier, rt::Watchdog::Remedy remedy) {
    const auto of =
        std::find_if(workers_.begin(), workers_.end(), [&](const Worker& w) { return w.watched == tier; });
    if (of == workers_.end()) return;
    switch (remedy) {
      case rt::Watchdog::Remedy::kRestart:
        events.push_back(told(*of, true));
        break;
      case rt::Watchdog::Remedy::kGiveUp:
        events.push_back(told(*of, false) + "; going on without it");
        break;
      case rt::Watchdog::Remedy::kRecovered:
        events.push_back(of->name + " is alive again");
        break;
    }
  });
}

// What is wrong with it. A body that has left is started again; one that hangs in a system call cannot be
// taken away.
std::string WatchedThreads::told(Worker& worker, bool restart) {
  if (worker.thread.running()) return worker.name + " is stuck";
  if (!worker.thread.failure().empty()) worker.reason = worker.thread.failure();
  std::string text = worker.name + " has left";
  if (!worker.thread.failure().empty()) text += " (" + worker.thread.failure() + ")";
  if (restart) text += worker.thread.start(worker.body) ? "; started again" : "; the system gives no thread";
  return text;
}

std::string WatchedThreads::reasonOf(std::string_view name) const {
  const auto of =
      std::find_if(workers_.begin(), workers_.end(), [&](const Worker& w) { return w.name == name; });
  if (of == workers_.end()) return "";
  return of->thread.running() || of->thread.failure().empty() ? of->reason : of->thread.failure();
}

void WatchedThreads::unwatch() {
  for (std::size_t i = 0; i < watchdog_.tiers(); ++i) watchdog_.unwatch(i);
}

std::vector<std::string> WatchedThreads::join(const std::function<bool()>& more_time) {
  constexpr std::int64_t kLook_ns = 2'000'000;
  std::vector<std::string> still;
  for (Worker& worker : workers_) {
    while (worker.thread.running() && more_time()) rt::restFor(kLook_ns);
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
