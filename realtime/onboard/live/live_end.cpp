#include <algorithm>
#include <cstdlib>

#include "realtime/base/units.hpp"
#include "realtime/kernel/threads/rt_thread.hpp"
#include "realtime/onboard/live/live_system.hpp"

// How a live run ends: every wait has a deadline.
namespace fathom::onboard {
namespace {

constexpr std::int64_t kDevicesEndNs = 150'000'000;      // devices' threads leave within this
constexpr std::int64_t kLongestJoinNs = 10'000'000'000;  // of a program that is given up

}  // namespace

bool LiveSystem::waitFor(const std::function<bool()>& done, std::int64_t until_ns) {
  while (!done()) {
    if (clock_.monotonicNs() >= until_ns) return false;
    rt::restFor(rt::kPollRest_ns);
  }
  return true;
}

void LiveSystem::finishThreads(End& end, std::int64_t until_ns, bool dive_ends) {
  stop_hard_ = stop_modem_ = stop_recorder_ = true;
  const std::vector<std::string> still = threads_.join([&] { return clock_.monotonicNs() < until_ns; });
  for (const std::string& name : still) end.left_out.push_back(name + " hangs and is left behind");
  hangs_ = !still.empty();
  stopped_ = true;
  // One that hangs in the middle of it has the recorder.
  if (std::find(still.begin(), still.end(), "recorder") != still.end()) {
    end.left_out.emplace_back("the recording is not closed");
    return;
  }
  takeFromMapper();
  const io::Recorder::CloseResult closed = recorder_.close(rt::seconds(until_ns - clock_.monotonicNs()));
  if (!closed.text.empty() && (dive_ends || !closed.log_whole)) end.left_out.push_back(closed.text);
}

LiveSystem::End LiveSystem::end(double most_s) {
  End end;
  if (stopped_) return end;
  // The last part of the time is for what follows a map that does not come.
  constexpr double kForTheRest = 0.9;
  const std::int64_t begin = clock_.monotonicNs();
  const std::int64_t until = begin + rt::nanoseconds(most_s),
                     map_until = begin + rt::nanoseconds(most_s * kForTheRest);
  ends_ = true;
  measured_.cpu = cpuTimes();
  measured_.heap_used = heap_.usedOfReserve();
  measured_.heap_overflow = heap_.overflowBytes();
  threads_.unwatch();
  stop_devices_ = true;
  // What the devices gave so far comes before the end.
  rt::restFor(kDevicesEndNs);
  const bool marked = waitFor(
                          [&] {
                            return hard_.mark({io::Mark::Kind::kEnd, 0});
                          },
                          map_until) &&
                      waitFor([&] { return hard_.ended(); }, map_until);
  if (!marked) end.left_out.emplace_back("navigation hangs: the log has no end");
  std::vector<std::string> events;
  const auto mapped = [&] {
    supervisor_->stepMapper(events);
    return supervisor_->mapperDone();
  };
  if (!waitFor(mapped, map_until)) {
    end.left_out.emplace_back("the map was not finished in time; make it from the recording");
    child_->kill();
  }
  for (const std::string& event : events) end.left_out.push_back(event);
  end.mapped = supervisor_->phase() == MapperPhase::kEnded;
  end.no_map = supervisor_->phase() == MapperPhase::kNoMap;
  finishThreads(end, until, true);
  return end;
}

LiveSystem::End LiveSystem::leave(double most_s) {
  End end;
  if (stopped_) return end;
  const std::int64_t until = clock_.monotonicNs() + rt::nanoseconds(most_s);
  ends_ = true;
  measured_.cpu = cpuTimes();
  threads_.unwatch();
  supervisor_->stopRestarts();
  // So that the next start has little to catch up with; if it comes to nothing, there is an older one.
  constexpr double kForTheState = 0.3;
  MapperFigures before, now;
  (void)channel_.up().figures.read(before);
  supervisor_->askForCheckpoint();
  (void)supervisor_->step(hard_skipped_.load(std::memory_order_relaxed));
  const auto saved = [&] {
    return !child_->running() ||
           (channel_.up().figures.read(now) && now.checkpoints.written > before.checkpoints.written);
  };
  (void)waitFor(saved, clock_.monotonicNs() + rt::nanoseconds(most_s * kForTheState));
  child_->kill();
  stop_devices_ = true;
  finishThreads(end, until, false);
  return end;
}

LiveSystem::~LiveSystem() {
  if (stopped_) return;
  ends_ = stop_devices_ = stop_hard_ = stop_modem_ = stop_recorder_ = true;
  go_ = true;
  const std::int64_t until = clock_.monotonicNs() + kLongestJoinNs;
  if (threads_.join([&] { return clock_.monotonicNs() < until; }).empty()) return;
  // What hangs would be waited for for ever, and what it uses is about to go.
  std::_Exit(EXIT_FAILURE);
}

}  // namespace fathom::onboard
