#pragma once

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/monitor/session_files.hpp"

namespace fathom::monitor {

// Prints a line of progress every 10 s and saves the exports every 30 s, both once more at the end, and
// reports what cannot be stored on stderr and in SharedModel::not_kept. Runs until its destruction on its own
// thread, so that neither frames nor answers to the vehicle wait for it.
class SessionKeeper {
 public:
  // `files`: of reception, asked for trouble() under the model's lock; null, and an empty `folder`: nothing
  // is stored.
  SessionKeeper(SharedModel& shared, const SessionFiles* files, const std::filesystem::path& folder);
  ~SessionKeeper();  // after the last save
  SessionKeeper(const SessionKeeper&) = delete;
  SessionKeeper& operator=(const SessionKeeper&) = delete;

 private:
  void run();
  void save();
  void reportTrouble();
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
