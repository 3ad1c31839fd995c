#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/recorder/log_stage.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::io {

// What may still be written with so much room on the disk. A step down is taken at once, a step back up only
// when there is an eighth more room than the reserve, so that a disk at the edge does not flicker.
class DiskGuard {
 public:
  enum class Level : std::uint8_t { kRoom, kImagesStopped, kRawStopped };

  DiskGuard(double image_reserve_mib, double log_reserve_mib)
      : image_reserve_(image_reserve_mib), log_reserve_(log_reserve_mib) {}

  Level update(double free_mib) {
    constexpr double kBackUp = 1.125;
    const bool raw = free_mib < log_reserve_ * (level_ == Level::kRawStopped ? kBackUp : 1.0);
    const bool images = free_mib < image_reserve_ * (level_ != Level::kRoom ? kBackUp : 1.0);
    level_ = raw ? Level::kRawStopped : images ? Level::kImagesStopped : Level::kRoom;
    return level_;
  }
  [[nodiscard]] Level level() const { return level_; }

 private:
  double image_reserve_, log_reserve_;  // [MiB]
  Level level_ = Level::kRoom;
};

// What an earlier run left in img/ besides the images that its log names.
struct FoundImages {
  std::uint64_t without_event = 0;  // whole, newer than the log's last events; kept
  std::uint64_t halves_removed = 0;
};

// Compares the newest images with the end of the log, after the log was cut behind its last whole entry;
// removes unfinished ones ("*.tmp"). The log's older part is not read.
[[nodiscard]] FoundImages findImages(const MissionPaths& paths);

// The mission folder that a recorder writes into: prepared, its log opened, the remains of an earlier run
// counted. A disk that refuses is asked again after 1 s, then after twice as long each time, up to 30 s.
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
