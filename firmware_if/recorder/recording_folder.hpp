#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/recorder/found_recording.hpp"
#include "firmware_if/recorder/journal_file.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// The mission folder that a recorder writes into: prepared, the log in it opened, and what an earlier run
// left looked at. A disk that refuses is asked again after 1 s, then after twice as long each time, up to 30
// s.
class RecordingFolder {
 public:
  // Takes the log's memory and touches no disk.
  RecordingFolder(const std::filesystem::path& folder, const MissionConfig& mission, const StereoRig& rig,
                  const RecorderConfig& config);

  // Asks the disk when it is time to (monotonic); true when all is open. Throws InputError for what is an
  // operator's mistake: a folder that is no mission's or another dive's, a file that is no LCM log.
  bool open(std::int64_t now_ns);
  // The next open() asks at once.
  void hurry() { next_try_ns_ = 0; }

  [[nodiscard]] bool isOpen() const { return log_.isOpen(); }
  [[nodiscard]] std::uint64_t refusals() const { return refusals_; }  // of open()
  // Why the last open() was refused, in words.
  [[nodiscard]] const std::string& failure() const { return failure_; }
  // The rest only when it is open.
  [[nodiscard]] JournalFile& log() { return log_; }
  [[nodiscard]] const JournalFile& log() const { return log_; }
  [[nodiscard]] const MissionConfig& mission() const { return mission_; }
  [[nodiscard]] const FoundImages& found() const { return found_; }

 private:
  [[nodiscard]] bool openAll();

  MissionPaths paths_;
  MissionConfig mission_;
  StereoRig rig_;
  RecorderConfig config_;
  JournalFile log_;
  FoundImages found_;
  std::uint64_t refusals_ = 0;
  std::int64_t next_try_ns_ = 0, pause_ns_ = 0;
  std::string failure_;
};

}  // namespace fathom::io
