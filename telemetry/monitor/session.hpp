#pragma once

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "realtime/base/files/descriptor.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

// A monitor's files of reception in a folder: received.bin, every accepted link frame as it arrived
// (packets.bin's format, read back after a restart), and frames.log, one line a frame. When the disk refuses,
// up to kMostWaiting bytes wait in memory and are written when there is room; trouble() says what is not
// stored.
class SessionFiles {
 public:
  // Creates the folder and opens both logs at their ends. Throws InputError if that fails.
  explicit SessionFiles(std::filesystem::path folder);
  ~SessionFiles();

  // Passes every frame of an earlier run's received.bin to `take`, which returns its verdict; returns the
  // number of whole frames. Skips damage and calls `on_damage` before the next frame; cuts off a damaged end.
  // `damage` becomes a sentence about it.
  using Take = std::function<telemetry::FrameVerdict(std::span<const std::uint8_t>, std::int64_t)>;
  std::size_t reload(const Take& take, const std::function<void()>& on_damage, std::string& damage);
  // Also keeps accepted frames in received.bin, unless `recorded`. frames.log gets `utc_ns verdict type
  // vehicle dive sequence bytes`; "-" for what a rejected frame lacks. Rejected frames beyond
  // kMaxRejectedLines are not logged, so that noise on the port cannot fill the disk.
  void log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes, std::int64_t utc_ns,
           bool recorded);
  // Writes and synchronises all that was received, so that it survives a power cut; false: some is not stored
  // and must not be acknowledged.
  [[nodiscard]] bool keep();
  // What cannot be stored now, a sentence; "": nothing.
  [[nodiscard]] std::string trouble() const;

 private:
  void write();

  static constexpr std::size_t kMostWaiting = std::size_t{16} << 20;  // [B]: a dive over a modem
  static constexpr std::uint64_t kMaxRejectedLines = 100'000;
  std::filesystem::path folder_;
  std::ofstream log_;
  Descriptor received_;
  std::vector<std::uint8_t> waiting_;  // bytes of received.bin that are not written yet
  bool synced_ = true;
  std::uint64_t lost_ = 0;  // frames for which there was no room in waiting_
  std::string received_trouble_;
  std::uint64_t rejected_lines_ = 0;
};

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
