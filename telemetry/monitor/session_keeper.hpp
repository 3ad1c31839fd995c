#pragma once

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "telemetry/monitor/export/export_files.hpp"
#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/monitor/session_files.hpp"

namespace fathom::monitor {

// What a monitor does beside reception, on a thread of its own so that no frame and no answer to the vehicle
// waits for it: a line of progress every 10 s, the exports every 30 s, both once more at the end; and what
// cannot be kept, on stderr and in SharedModel::not_kept. Nothing ends it before its destruction.
class SessionKeeper {
 public:
  // `files`: of reception, asked for trouble under the model's lock; null and no `folder`: nothing is kept.
  SessionKeeper(SharedModel& shared, const SessionFiles* files, const std::filesystem::path& folder);
  ~SessionKeeper();  // after the last save
  SessionKeeper(const SessionKeeper&) = delete;
  SessionKeeper& operator=(const SessionKeeper&) = delete;

 private:
  void run();
  void save();
  void tellTrouble();
  void printProgress();

  SharedModel& shared_;
  const SessionFiles* files_;
  std::optional<ExportFiles> exports_;
  ModelView view_;
  std::string trouble_;
  std::uint64_t printed_version_ = 0;
  std::mutex mutex_;
  std::condition_variable ends_;
  bool ending_ = false;
  std::thread thread_;  // last: it uses the rest
};

}  // namespace fathom::monitor
