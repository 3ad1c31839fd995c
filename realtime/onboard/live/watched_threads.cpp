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

void WatchedThreads::start() {
  for (Worker& worker : workers_) (void)worker.thread.start(worker.body);
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
        // A body that has left is started again; one that hangs in a system call cannot be taken away.
        events.push_back(of->name + " is stuck" +
                         (!of->thread.running() && of->thread.start(of->body) ? "; started again" : ""));
        break;
      case rt::Watchdog::Remedy::kGiveUp:
        events.push_back(of->name + " is stuck; going on without it");
        break;
      case rt::Watchdog::Remedy::kRecovered:
        events.push_back(of->name + " is alive again");
        break;
    }
  });
}

void WatchedThreads::unwatch() {
  for (std::size_t i = 0; i < watchdog_.tiers(); ++i) watchdog_.unwatch(i);
}

void WatchedThreads::joinAllBut(std::initializer_list<std::string_view> names) {
  for (Worker& worker : workers_)
    if (std::find(names.begin(), names.end(), worker.name) == names.end()) worker.thread.join();
}

std::size_t WatchedThreads::stackBytes() const {
  std::size_t bytes = 0;
  for (const Worker& worker : workers_) bytes += worker.thread.stackBytes();
  return bytes;
}

}  // namespace fathom::onboard
