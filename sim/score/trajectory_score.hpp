#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "sim/score/score.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::sim {

// truth/trajectory.csv and truth/images.csv of a mission.
class TruthTrack {
 public:
  // Throws InputError for a folder without truth.
  explicit TruthTrack(const std::filesystem::path& truth_folder);

  // Pose of body in nav; std::nullopt outside the recorded time.
  [[nodiscard]] std::optional<SE3> poseAt(std::int64_t utc_ns) const;
  // True time of the exposure that gave a left image, if it is listed.
  [[nodiscard]] std::optional<std::int64_t> exposureOf(const std::string& left_image) const;
  struct Pair {
    std::int64_t utc_ns = 0;  // true time of the exposure
    std::string left, right;  // file names within img/
  };
  // All pairs, as listed; empty when they are not.
  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }
  // True exposure times of all pairs, in order; empty when they are not listed.
  [[nodiscard]] const std::vector<std::int64_t>& exposures() const { return exposures_; }
  [[nodiscard]] std::int64_t beginUtcNs() const { return points_.front().utc_ns; }

 private:
  std::vector<io::TrajectoryPoint> points_;
  std::map<std::string, std::int64_t> image_times_;
  std::vector<Pair> pairs_;
  std::vector<std::int64_t> exposures_;
};

// Estimated and true camera positions of the same exposures.
struct CameraTracks {
  Points estimate, truth;  // nav [m]
  Points turn;             // from true to estimated axes, about north, east and down [rad]
  std::vector<double> time_s;
  std::vector<std::string> left_images;
};
// Pairs each estimated pose with the truth by its left image, else by its time. Poses of another origin are
// transformed into the mission's frame.
[[nodiscard]] CameraTracks pairTracks(const io::StereoPoseFile& file, const TruthTrack& truth,
                                      const io::MissionConfig& mission);

[[nodiscard]] TrajectoryScore scoreTrack(const CameraTracks& tracks);
// Adds NEES by the stated covariances of the poses.
void scoreCovariances(const CameraTracks& tracks, const std::vector<io::PoseCovariance>& covariances,
                      TrajectoryScore& score);

// Odometry, shifted horizontally so that it begins at the truth, over the time of the survey's exposures (all
// of its time when they are not listed). std::nullopt when it shares no time with the truth.
[[nodiscard]] std::optional<TrajectoryScore> scoreOdometry(const std::vector<io::TrajectoryPoint>& odometry,
                                                           const TruthTrack& truth);

}  // namespace fathom::sim
