#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "realtime/onboard/output/growing_file.hpp"

namespace fathom::onboard {

// The folder onboard/ of a mission: it appears whole, and on the disk, in commit(). Without commit() nothing
// of it stays, unless it is made to outlive its program. Rows go to files as they come, so that memory does
// not grow with the mission.
//
// A disk that refuses throws in the constructor and in commit(), nowhere else. Until then rows wait in a
// buffer (GrowingFile) and are written when the disk takes them; once a buffer is full rows are lost, and
// lost() is true. Used by one thread.
class OnboardOutput {
 public:
  // Throws InputError for a folder that holds anything but an earlier replay, std::runtime_error where
  // nothing can be written. `planned_hours`: disk space for the rows of so many hours is reserved.
  OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin,
                const OutputFolder::Life& life = OutputFolder::Life(), double planned_hours = 0);
  OnboardOutput(const OnboardOutput&) = delete;
  OnboardOutput& operator=(const OnboardOutput&) = delete;

  // Where the files grow until commit().
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_.path(); }

  void addOdometry(std::int64_t utc_ns, const SE3& T_odom_body);
  void addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                     double altitude);
  // A keyframe has retired: its pairs are anchored to another.
  void addRetired(const slam::NavigationGraph::Retired& gone);
  // The survey is over: replaces the poses by the final ones.
  void placeStereoPoses(const std::function<SE3(const MapOutput&)>& T_nav_cam);
  // After that: loop closures, named by the left images of their keyframes; chi2 against the poses now.
  void writeClosures(const LocalisationCore& localisation);
  void addPacket(std::int64_t utc_ns, std::span<const std::uint8_t> frame);
  // A frame received; the file exists only if there was one.
  void addDownlink(std::int64_t utc_ns, std::span<const std::uint8_t> frame);
  // The first row's names become health.csv's header; every row has the same columns.
  void addHealth(std::int64_t utc_ns, const std::vector<std::pair<std::string, double>>& row);
  void writeMap(const Mesh& map_in_nav);
  void writeText(const std::string& name, const std::string& text);

  // Throws std::runtime_error, and leaves what is in folder(), when rows or files are missing or the disk
  // refuses.
  void commit();

  // Rows are missing: only load() of an earlier state, or a replay, makes the folder complete.
  [[nodiscard]] bool lost() const;
  // Tests the disk: writes waiting rows, or an empty block; waits for the disk.
  [[nodiscard]] bool diskTakesData();
  // After writing: invalid rows of pairs were read, as after a disk that lost data.
  [[nodiscard]] bool rowsDamaged() const { return rows_damaged_; }
  // The file that the disk refuses, or of which rows are missing, and why; "" when well.
  [[nodiscard]] std::string failure() const;

  // Saved state is the length of the files, to which load() truncates them. readyToSave() writes waiting
  // rows; false while the disk refuses or rows are missing: a state saved then is valid for this process
  // only.
  [[nodiscard]] bool readyToSave();
  void save(rt::StateWriter& writer);
  [[nodiscard]] bool load(rt::StateReader& reader);
  // Files that must be on the disk before a saved state that refers to them.
  [[nodiscard]] std::vector<std::filesystem::path> files() const;

 private:
  template <typename Archive>
  void exchange(Archive& archive);
  void attempt(const std::string& name, const std::function<void()>& write);
  [[nodiscard]] bool probe() const;
  void writeClosuresFile(const LocalisationCore& localisation);
  void readPairs();
  // Final successor of each retired keyframe.
  [[nodiscard]] std::map<int, slam::NavigationGraph::Retired> readRetired();

  OutputFolder folder_;
  GrowingFile odometry_, pairs_, packets_, downlink_, health_, retired_;
  std::array<GrowingFile*, 6> files_{&odometry_, &pairs_, &packets_, &downlink_, &health_, &retired_};
  std::string failed_;  // the first of the other files that could not be written, and why
  bool rows_damaged_ = false;
  io::StereoPoseFile poses_;        // once the survey is over
  std::vector<MapOutput> outputs_;  // of the same pairs
  std::vector<std::uint8_t> record_;
  RowStream row_;
  bool health_header_ = false;
};

}  // namespace fathom::onboard
