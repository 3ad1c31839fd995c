#include "telemetry/monitor/session_keeper.hpp"

#include <chrono>
#include <exception>
#include <iostream>
#include <sstream>

namespace fathom::monitor {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

namespace {
constexpr auto kTroubleInterval = 1s, kProgressInterval = 10s, kSaveInterval = 30s;
}  // namespace

SessionKeeper::SessionKeeper(SharedModel& shared, const SessionFiles* files,
                             const std::filesystem::path& folder)
    : shared_(shared), files_(files) {
  if (!folder.empty()) exports_.emplace(folder);
  thread_ = std::thread([this] { run(); });
}

SessionKeeper::~SessionKeeper() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  ends_.notify_all();
  thread_.join();
}

void SessionKeeper::run() {
  auto next_progress = Clock::now() + kProgressInterval, next_save = Clock::now() + kSaveInterval;
  for (bool last = false; !last;) {
    {
      std::unique_lock lock(mutex_);
      last = ends_.wait_for(lock, kTroubleInterval, [this] { return ending_; });
    }
    try {
      const auto now = Clock::now();
      if (last || now >= next_save) {
        next_save = now + kSaveInterval;
        save();
      }
      reportTrouble();
      if (last || now >= next_progress) {
        next_progress = now + kProgressInterval;
        printProgress();
      }
    } catch (const std::exception& error) {
      // Out of memory: tried again the next time.
      std::cerr << "fathom-monitor: " << error.what() << std::endl;
    }
  }
}

void SessionKeeper::save() {
  if (!exports_) return;
  view_.refresh(shared_);
  exports_->save(view_);
}

void SessionKeeper::reportTrouble() {
  std::string now;
  {
    const std::lock_guard lock(shared_.mutex);
    if (files_ != nullptr) now = files_->trouble();
    if (exports_ && !exports_->trouble().empty()) now += (now.empty() ? "" : "; ") + exports_->trouble();
    if (now == trouble_) return;
    shared_.not_kept = now;
  }
  trouble_ = std::move(now);
  std::cerr << "fathom-monitor: " << (trouble_.empty() ? "everything is stored again" : trouble_)
            << std::endl;
}

void SessionKeeper::printProgress() {
  std::ostringstream line;
  {
    const std::lock_guard lock(shared_.mutex);
    const MonitorModel& model = *shared_.model;
    if (model.version() == printed_version_) return;
    printed_version_ = model.version();
    const auto& c = model.receiver().counters();
    const std::uint64_t accepted = c[telemetry::FrameVerdict::kAccepted];
    line << "frames " << accepted << " accepted, " << c.lost << " lost, " << c.repaired << " repaired, "
         << c.frames - accepted << " rejected; " << c.bytes << " bytes; ";
    view_.take(model, shared_.epoch, shared_.now_utc_ns);
  }
  line << "map " << view_.store().size() << " blocks, " << static_cast<long>(view_.surface().area())
       << " m2; track " << view_.track().size() << " points";
  std::cout << line.str() << std::endl;
}

}  // namespace fathom::monitor
