#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "firmware_if/pose_files.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "recon/geometry/output_folder.hpp"

namespace fathom::onboard {

// The folder onboard/ of a mission: it appears whole in commit(). Without commit() nothing of it stays.
class OnboardOutput {
 public:
  // Throws InputError for a folder that holds anything but an earlier replay.
  OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin);
  OnboardOutput(const OnboardOutput&) = delete;
  OnboardOutput& operator=(const OnboardOutput&) = delete;

  // Where the files grow until commit().
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_.path(); }

  void addOdometry(std::int64_t utc_ns, const SE3& T_odom_body) {
    odometry_.push_back({utc_ns, T_odom_body});
  }
  void addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                     double altitude);
  // Replaces the poses by what is known of them now.
  void placeStereoPoses(const std::function<SE3(const MapOutput&)>& T_nav_cam);
  // Loop closures, named by the left images of their keyframes; chi2 against the poses now.
  void writeClosures(const LocalisationCore& localisation);
  void addPacket(std::int64_t utc_ns, std::span<const std::uint8_t> frame);
  // A frame received; the file exists only if there was one.
  void addDownlink(std::int64_t utc_ns, std::span<const std::uint8_t> frame);
  // The first row's names become health.csv's header; every row has the same columns.
  void addHealth(std::int64_t utc_ns, const std::vector<std::pair<std::string, double>>& row);
  void writeMap(const Mesh& map_in_nav);
  void writeText(const std::string& name, const std::string& text);

  void commit();

 private:
  OutputFolder folder_;
  std::vector<io::TrajectoryPoint> odometry_;
  io::StereoPoseFile poses_;
  std::vector<MapOutput> outputs_;  // of the same pairs
  std::ofstream packets_, downlink_, health_;
  bool health_header_ = false;
};

}  // namespace fathom::onboard
