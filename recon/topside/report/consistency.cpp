#include "recon/topside/report/slam_report.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "recon/closure/candidates.hpp"

namespace fathom::topside {
namespace {

constexpr double kHigh95 = 12.59;             // chi-square, 6 degrees of freedom
constexpr std::size_t kLinkedByOdometry = 3;  // pairs between two that odometry links

std::optional<SE3> truthAt(const std::vector<io::TrajectoryPoint>& truth, std::int64_t utc_ns) {
  const auto after =
      std::lower_bound(truth.begin(), truth.end(), utc_ns,
                       [](const io::TrajectoryPoint& p, std::int64_t t) { return p.utc_ns < t; });
  if (after == truth.end() || (after == truth.begin() && after->utc_ns != utc_ns)) return std::nullopt;
  if (after->utc_ns == utc_ns) return after->pose;
  const auto before = after - 1;
  return interpolate(
      before->pose, after->pose,
      static_cast<double>(utc_ns - before->utc_ns) / static_cast<double>(after->utc_ns - before->utc_ns));
}

// Right perturbation (rho, phi) from one pose to another.
Vector6d apart(const SE3& from, const SE3& to) {
  const SE3 off = from.inverse() * to;
  Vector6d e;
  e << off.translation(), (off.rotation().w() < 0 ? -2 : 2) * off.rotation().vec();
  return e;
}

Matrix6d inNavAxes(const SE3& pose) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = pose.matrix3();
  return turn;
}

// T_nav_cam of every pair.
std::vector<std::optional<SE3>> trueCameras(const std::filesystem::path& folder, const SE3& T_body_cam,
                                            const PairList& list, const SlamResult& slam) {
  const std::vector<io::TrajectoryPoint> truth = io::readTrajectory(folder / "trajectory.csv");
  std::map<std::string, std::int64_t> exposed;
  for (const io::ImageTime& image : io::readImageTimes(folder / "images.csv"))
    exposed[image.left] = image.utc_ns;
  std::vector<std::optional<SE3>> cameras(slam.poses.size());
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    const auto known = exposed.find(list.pairs[k].left);
    const auto body = truthAt(truth, known == exposed.end() ? slam.poses[k].utc_ns : known->second);
    if (body) cameras[k] = *body * T_body_cam;
  }
  return cameras;
}

// Closures against the truth: how many are false, and how many of the true overlaps were found.
void judgeClosures(const std::vector<std::optional<SE3>>& cameras, const Camera& camera,
                   const SlamResult& slam, Consistency& out) {
  const auto squared = [&](const std::vector<slam::NavigationLink>& links) {
    double sum = 0;
    std::size_t n = 0;
    for (const slam::NavigationLink& link : links) {
      if (!cameras[link.a] || !cameras[link.b]) continue;
      const Vector6d e = apart(cameras[link.a]->inverse() * *cameras[link.b], link.T_a_b);
      sum += e.dot(link.covariance.ldlt().solve(e));
      ++n;
    }
    return n == 0 ? 0 : sum / static_cast<double>(n);
  };
  out.mean_squared_odometry = squared(slam.odometry);
  out.mean_squared_closures = squared(slam.closures);
  for (const slam::NavigationLink& c : slam.closures) {
    if (!cameras[c.a] || !cameras[c.b]) continue;
    const Vector6d e = apart(cameras[c.a]->inverse() * *cameras[c.b], c.T_a_b);
    const bool wrong =
        e.head<3>().norm() > Consistency::kFalsePosition || e.tail<3>().norm() > Consistency::kFalseTurn;
    out.false_closures += wrong ? 1U : 0U;
    out.false_closures_kept += wrong && c.kept ? 1U : 0U;
  }
  const double apart_at = closure::separationOfOverlap(Consistency::kOverlap);
  std::vector<std::optional<closure::Footprint>> seen(cameras.size());
  for (std::size_t k = 0; k < cameras.size(); ++k)
    if (cameras[k] && slam.poses[k].altitude)
      seen[k] = closure::footprintOf(
          *cameras[k], closure::rangeToLevelGround(*cameras[k], *slam.poses[k].altitude), camera);
  const auto overlap = [&](std::size_t a, std::size_t b) {
    return seen[a] && seen[b] &&
           (seen[a]->centre - seen[b]->centre).norm() < apart_at * std::min(seen[a]->radius, seen[b]->radius);
  };
  for (std::size_t b = 0; b < seen.size(); ++b)
    for (std::size_t a = 0; a + kLinkedByOdometry < b; ++a) out.overlapping += overlap(a, b) ? 1U : 0U;
  for (const SlamResult::Tried& t : slam.tried) {
    if (!overlap(t.a, t.b)) continue;
    ++out.overlapping_tried;
    out.overlapping_accepted += t.accepted ? 1U : 0U;
  }
}

}  // namespace

Consistency compareWithTruth(const std::filesystem::path& mission, const SE3& T_body_cam,
                             const Camera& camera, const PairList& list, const SlamResult& slam) {
  Consistency out;
  const std::filesystem::path folder = mission / "truth";
  if (!std::filesystem::exists(folder / "trajectory.csv")) return out;
  // The camera's mounting may be wrong in mission.toml.
  const SE3 mounted = std::filesystem::exists(folder / "mission.toml")
                          ? io::readMissionConfig(folder).T_body_cam
                          : T_body_cam;
  const std::vector<std::optional<SE3>> cameras = trueCameras(folder, mounted, list, slam);
  std::optional<SE3> first_truth;
  SE3 first;
  std::int64_t first_ns = 0;
  std::size_t inside = 0, later = 0;
  for (const SlamResult::Uncertain& u : slam.uncertain) {
    const std::int64_t utc_ns = slam.poses[u.pair].utc_ns;
    if (!cameras[u.pair]) continue;
    const SE3& T_nav_cam = *cameras[u.pair];
    if (!first_truth) {
      first_truth = T_nav_cam;
      first = u.T_nav_cam;
      first_ns = utc_ns;
    }
    Consistency::Moment m;
    m.time_s = static_cast<double>(utc_ns - first_ns) * 1e-9;
    const Vector6d e = apart(T_nav_cam, u.T_nav_cam);
    const Matrix6d turn = inNavAxes(u.T_nav_cam);
    const Vector6d in_nav = turn * e;
    const Matrix6d covariance = turn * u.covariance * turn.transpose();
    m.position = in_nav.head<3>();
    m.turn = in_nav.tail<3>();
    m.sigma_position = covariance.diagonal().head<3>().cwiseSqrt();
    m.sigma_turn = covariance.diagonal().tail<3>().cwiseSqrt();
    m.squared = e.dot(u.covariance.ldlt().solve(e));
    if (!out.moments.empty()) {
      const Vector6d relative = apart(first_truth->inverse() * T_nav_cam, first.inverse() * u.T_nav_cam);
      m.since_first = relative.dot(u.since_first.ldlt().solve(relative));
      out.mean_since_first += m.since_first;
      ++later;
    }
    inside += m.squared <= kHigh95 ? 1U : 0U;
    out.mean_squared += m.squared;
    out.moments.push_back(m);
  }
  if (out.moments.empty()) return out;
  judgeClosures(cameras, camera, slam, out);
  const auto n = static_cast<double>(out.moments.size());
  out.mean_squared /= n;
  out.mean_since_first /= std::max(static_cast<double>(later), 1.0);
  out.share_inside = static_cast<double>(inside) / n;
  return out;
}

}  // namespace fathom::topside
