#include "sim/score/trajectory_score.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"

namespace fathom::sim {
namespace {

constexpr double kOtherPass = 30.0;  // poses further apart in time belong to other passes [s]
constexpr double kSamePlace = 0.7;   // horizontal distance within which two passes cross [m]

// The error of relative positions between poses of different passes over one place.
std::optional<double> crossoverRms(const CameraTracks& t) {
  using Cell = std::pair<std::int64_t, std::int64_t>;
  const auto cellOf = [](const Eigen::Vector3d& p) {
    return Cell(static_cast<std::int64_t>(std::floor(p.x() / kSamePlace)),
                static_cast<std::int64_t>(std::floor(p.y() / kSamePlace)));
  };
  std::map<Cell, std::vector<std::size_t>> cells;
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < t.truth.size(); ++i) {
    const Cell own = cellOf(t.truth[i]);
    for (std::int64_t dn = -1; dn <= 1; ++dn) {
      for (std::int64_t de = -1; de <= 1; ++de) {
        const auto cell = cells.find({own.first + dn, own.second + de});
        if (cell == cells.end()) continue;
        for (const std::size_t j : cell->second) {
          if (std::abs(t.time_s[i] - t.time_s[j]) <= kOtherPass) continue;
          const Eigen::Vector3d apart = t.truth[i] - t.truth[j];
          if (apart.head<2>().norm() >= kSamePlace) continue;
          sum += (t.estimate[i] - t.estimate[j] - apart).squaredNorm();
          ++count;
        }
      }
    }
    cells[own].push_back(i);
  }
  if (count == 0) return std::nullopt;
  return std::sqrt(sum / static_cast<double>(count));
}

double rms(const Points& a, const Points& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

}  // namespace

TruthTrack::TruthTrack(const std::filesystem::path& truth_folder) {
  const std::filesystem::path file = truth_folder / "trajectory.csv";
  if (!std::filesystem::exists(file))
    throw InputError(file.string(), "", "is absent; only simulated missions have a truth to score against");
  points_ = io::readTrajectory(file);
  if (points_.empty()) throw InputError(file.string(), "", "has no poses; make the mission again");
  const auto earlier = [](const io::TrajectoryPoint& a, const io::TrajectoryPoint& b) {
    return a.utc_ns < b.utc_ns;
  };
  if (!std::is_sorted(points_.begin(), points_.end(), earlier))
    throw InputError(file.string(), "", "is not in the order of time; make the mission again");

  for (const io::ImageTime& image : io::readImageTimes(truth_folder / "images.csv")) {
    pairs_.push_back({image.utc_ns, image.left, image.right});
    image_times_[image.left] = image.utc_ns;
    exposures_.push_back(image.utc_ns);
  }
  std::sort(exposures_.begin(), exposures_.end());
}

std::optional<SE3> TruthTrack::poseAt(std::int64_t utc_ns) const {
  if (utc_ns < points_.front().utc_ns || utc_ns > points_.back().utc_ns) return std::nullopt;
  const auto after =
      std::lower_bound(points_.begin(), points_.end(), utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  if (after->utc_ns == utc_ns) return after->pose;
  const auto before = after - 1;
  const double s =
      static_cast<double>(utc_ns - before->utc_ns) / static_cast<double>(after->utc_ns - before->utc_ns);
  return interpolate(before->pose, after->pose, s);
}

std::optional<std::int64_t> TruthTrack::exposureOf(const std::string& left_image) const {
  const auto found = image_times_.find(std::filesystem::path(left_image).filename().string());
  if (found == image_times_.end()) return std::nullopt;
  return found->second;
}

CameraTracks pairTracks(const io::StereoPoseFile& file, const TruthTrack& truth,
                        const io::MissionConfig& mission) {
  const LocalTransverseMercator from(file.origin), to(mission.origin);
  CameraTracks tracks;
  for (const io::StereoPose& pose : file.poses) {
    const std::int64_t utc_ns = truth.exposureOf(pose.left_image).value_or(rt::nanoseconds(pose.utc_s));
    const auto T_nav_body = truth.poseAt(utc_ns);
    if (!T_nav_body) continue;
    Eigen::Vector3d estimate = pose.T_nav_cam.translation();
    if (file.origin.latitude != mission.origin.latitude || file.origin.longitude != mission.origin.longitude)
      estimate.head<2>() = to.toLocal(from.toGeodetic(estimate.head<2>()));
    tracks.estimate.push_back(estimate);
    const SE3 T_nav_cam = *T_nav_body * mission.T_body_cam;
    tracks.truth.push_back(T_nav_cam.translation());
    const Eigen::AngleAxisd turn(pose.T_nav_cam.rotation() * T_nav_cam.rotation().conjugate());
    tracks.turn.emplace_back(turn.angle() * turn.axis());
    tracks.left_images.push_back(pose.left_image);
    tracks.time_s.push_back(static_cast<double>(utc_ns - truth.beginUtcNs()) * 1e-9);
  }
  return tracks;
}

TrajectoryScore scoreTrack(const CameraTracks& tracks) {
  TrajectoryScore score;
  score.poses = tracks.truth.size();
  score.rms_m = rms(tracks.estimate, tracks.truth);
  const SE3 motion = alignRigid(tracks.estimate, tracks.truth);
  Points aligned;
  for (const Eigen::Vector3d& p : tracks.estimate) aligned.push_back(motion * p);
  score.aligned_rms_m = rms(aligned, tracks.truth);
  score.crossover_rms_m = crossoverRms(tracks);
  double tilt = 0, heading = 0;
  for (const Eigen::Vector3d& turn : tracks.turn) {
    tilt += turn.head<2>().squaredNorm();
    heading += turn.z() * turn.z();
  }
  score.tilt_rms_rad = std::sqrt(tilt / static_cast<double>(score.poses));
  score.heading_rms_rad = std::sqrt(heading / static_cast<double>(score.poses));
  return score;
}

void scoreCovariances(const CameraTracks& tracks, const std::vector<io::PoseCovariance>& covariances,
                      TrajectoryScore& score) {
  constexpr double kHigh95 = 12.59;  // chi-square, 6 degrees of freedom
  std::map<std::string, const Matrix6d*> of;
  for (const io::PoseCovariance& pose : covariances) of[pose.left_image] = &pose.covariance;
  double sum = 0;
  std::size_t count = 0, inside = 0;
  for (std::size_t k = 0; k < tracks.truth.size(); ++k) {
    const auto known = of.find(tracks.left_images[k]);
    if (known == of.end()) continue;
    Vector6d error;
    error << tracks.estimate[k] - tracks.truth[k], tracks.turn[k];
    const double squared = error.dot(known->second->ldlt().solve(error));
    sum += squared;
    ++count;
    inside += squared <= kHigh95 ? 1U : 0U;
  }
  if (count == 0) return;
  score.nees = sum / static_cast<double>(count);
  score.inside = static_cast<double>(inside) / static_cast<double>(count);
}

std::optional<TrajectoryScore> scoreOdometry(const std::vector<io::TrajectoryPoint>& odometry,
                                             const TruthTrack& truth) {
  std::optional<Eigen::Vector3d> shift;
  Points estimate, real;
  for (const io::TrajectoryPoint& point : odometry) {
    const auto pose = truth.poseAt(point.utc_ns);
    if (!pose) continue;
    if (!shift) {
      shift = pose->translation() - point.pose.translation();
      shift->z() = 0;  // depth is absolute
    }
    const auto& survey = truth.exposures();
    if (!survey.empty() && (point.utc_ns < survey.front() || point.utc_ns > survey.back())) continue;
    estimate.push_back(point.pose.translation() + *shift);
    real.push_back(pose->translation());
  }
  if (estimate.empty()) return std::nullopt;
  TrajectoryScore score;
  score.poses = estimate.size();
  score.rms_m = rms(estimate, real);
  return score;
}

}  // namespace fathom::sim
