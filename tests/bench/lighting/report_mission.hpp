#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/stereo/sparse_stereo.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::bench {

// A simulated mission with its truth: images, true poses of the left camera, the true seafloor.
class ReportMission {
 public:
  explicit ReportMission(const std::filesystem::path& folder);

  struct Pair {
    std::string left_name, right_name;
    SE3 T_nav_cam;            // of the left camera, true
    stereo::SeedPlane plane;  // level, at the altitude that a DVL's four beams would give
  };
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }
  [[nodiscard]] const StereoRig& rig() const { return rig_; }
  [[nodiscard]] const io::MissionConfig& config() const { return config_; }
  [[nodiscard]] io::ImageFile left(std::size_t pair) const;
  [[nodiscard]] io::ImageFile right(std::size_t pair) const;

  // Where the left camera of `pair` sees a distorted pixel, in nav; nothing beside the seafloor.
  [[nodiscard]] std::optional<Eigen::Vector3d> seafloorAt(std::size_t pair,
                                                          const Eigen::Vector2d& pixel) const;
  // The distorted pixel of a seafloor point, if the camera sees it and nothing is before it.
  [[nodiscard]] std::optional<Eigen::Vector2d> pixelOf(std::size_t pair, const Eigen::Vector3d& point) const;

 private:
  io::MissionPaths paths_;
  io::MissionConfig config_;
  StereoRig rig_;
  sim::TruthSurface surface_;
  std::vector<Pair> pairs_;
};

}  // namespace fathom::bench
