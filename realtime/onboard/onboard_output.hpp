#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/files/pose_files.hpp"
#include "realtime/kernel/state_archive_fwd.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "recon/geometry/output_folder.hpp"

namespace fathom::onboard {

// The folder onboard/ of a mission: it appears whole in commit(). Without commit() nothing of it stays,
// unless it is made to outlive its program. What comes row by row goes to files at once, so that memory does
// not grow with the mission.
class OnboardOutput {
 public:
  // Throws InputError for a folder that holds anything but an earlier replay. `planned_hours`: room on the
  // disk is taken for the rows of so long, which a disk that others fill later cannot take away.
  OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin,
                const OutputFolder::Life& life = OutputFolder::Life(), double planned_hours = 0);
  OnboardOutput(const OnboardOutput&) = delete;
  OnboardOutput& operator=(const OnboardOutput&) = delete;

  // Where the files grow until commit().
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_.path(); }

  void addOdometry(std::int64_t utc_ns, const SE3& T_odom_body);
  void addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                     double altitude);
  // A keyframe is gone: pairs that hang on it hang on another.
  void addRetired(const slam::NavigationGraph::Retired& gone);
  // The survey is over: replaces the poses by what is known of them now.
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

  void commit();

  // Saved state is how long the files are (they are first brought up to date); load() cuts them back to that.
  void save(rt::StateWriter& writer);
  [[nodiscard]] bool load(rt::StateReader& reader);
  // That saved state relies on: to be on the disk before it.
  [[nodiscard]] std::vector<std::filesystem::path> files() const;

 private:
  // A file that grows.
  struct Growing {
    const char* name;
    bool from_the_start;  // else it is there only once something was written
    double bytes_an_hour;
    std::ofstream stream{};
  };
  template <typename Archive>
  void exchange(Archive& archive);
  void open(Growing& file);
  void takeRoom(const Growing& file);
  void giveRoomBack();
  void cutBack(Growing& file, bool there, std::uint64_t bytes);
  void readPairs();
  // Where what hung on a keyframe that is gone hangs in the end.
  [[nodiscard]] std::map<int, slam::NavigationGraph::Retired> readRetired();

  OutputFolder folder_;
  double planned_hours_;
  std::array<Growing, 6> files_{{{"odometry.csv", true, 5e6},
                                 {"pairs.tmp", true, 5e6},
                                 {"packets.bin", true, 3e6},
                                 {"downlink.bin", false, 1e6},
                                 {"health.csv", true, 8e6},
                                 {"retired.tmp", true, 6e5}}};
  std::ofstream &odometry_ = files_[0].stream, &pairs_ = files_[1].stream, &packets_ = files_[2].stream,
                &health_ = files_[4].stream, &retired_ = files_[5].stream;
  Growing& downlink_ = files_[3];
  io::StereoPoseFile poses_;        // once the survey is over
  std::vector<MapOutput> outputs_;  // of the same pairs
  std::vector<std::uint8_t> record_;
  bool health_header_ = false;
};

}  // namespace fathom::onboard
