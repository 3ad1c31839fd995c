#include "recon/topside/report/pose_output.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"

namespace fathom::topside {

Eigen::Vector2d eastNorth(const SE3& T_nav) {
  return {T_nav.translation().y(), T_nav.translation().x()};
}

void writePoses(const std::filesystem::path& folder, const Geodetic& origin,
                const std::vector<FusedPair>& pairs) {
  const std::vector<bool> crossover = likelyCrossovers(pairs);
  io::StereoPoseFile stereo{origin, {}};
  io::VehiclePoseFile vehicle{origin, {}};
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const FusedPair& p = pairs[k];
    const int id = static_cast<int>(k);
    const double utc_s = static_cast<double>(p.pair.utc_ns) * 1e-9;
    stereo.poses.push_back(
        {id, utc_s, p.T_nav_cam, p.pair.left, p.pair.right, p.altitude, p.footprint_radius, crossover[k]});
    vehicle.poses.push_back({id, utc_s, p.T_nav_body, p.altitude});
  }
  io::writeStereoPoses(folder / "stereo_pose_est.data", stereo);
  io::writeVehiclePoses(folder / "vehicle_pose_est.data", vehicle);
}

void writePoseCovariances(const std::filesystem::path& folder, const std::vector<ImagePair>& pairs,
                          const SlamResult& slam) {
  std::vector<io::PoseCovariance> poses;
  for (const SlamResult::Uncertain& u : slam.uncertain) {
    Matrix6d to_nav = Matrix6d::Zero();
    to_nav.topLeftCorner<3, 3>() = to_nav.bottomRightCorner<3, 3>() = u.T_nav_cam.matrix3();
    poses.push_back({pairs[u.pair].left, to_nav * u.covariance * to_nav.transpose()});
  }
  io::writePoseCovariances(folder / "pose_covariances.csv", poses);
}

void writeClosures(const std::filesystem::path& path, const std::vector<ImagePair>& pairs,
                   const std::vector<slam::NavigationLink>& closures) {
  AtomicFile file(path);
  file.stream()
      << "left_a,left_b,x_m,y_m,z_m,qw,qx,qy,qz,sigma_position_m,sigma_rotation_rad,inliers,chi2,kept\n";
  for (const slam::NavigationLink& c : closures) {
    const Eigen::Vector3d& t = c.T_a_b.translation();
    const Eigen::Quaterniond& q = c.T_a_b.rotation();
    file.stream() << formatted(
        "%s,%s,%.5f,%.5f,%.5f,%.8f,%.8f,%.8f,%.8f,%.5f,%.6f,%d,%.3f,%d\n",
        tableField(pairs[c.a].left).c_str(), tableField(pairs[c.b].left).c_str(), t.x(), t.y(), t.z(), q.w(),
        q.x(), q.y(), q.z(), std::sqrt(c.covariance.topLeftCorner<3, 3>().trace() / 3),
        std::sqrt(c.covariance.bottomRightCorner<3, 3>().trace() / 3), c.inliers, c.chi2, c.kept ? 1 : 0);
  }
  file.commit();
}

std::vector<double> closureErrors(const std::vector<slam::NavigationLink>& closures,
                                  const std::vector<NavigatedPose>& poses, const SE3& T_body_cam) {
  std::vector<double> errors;
  for (const slam::NavigationLink& c : closures) {
    const auto &a = poses[c.a].T_nav_body, &b = poses[c.b].T_nav_body;
    if (!c.kept || !a || !b) continue;
    const SE3 between = (*a * T_body_cam).inverse() * (*b * T_body_cam);
    errors.push_back((between.translation() - c.T_a_b.translation()).norm());
  }
  return errors;
}

namespace {

// Pairs closer in time overlap because the vehicle is slow, not because it came back [ns].
constexpr std::int64_t kComeBack = 60'000'000'000;

}  // namespace

std::vector<bool> likelyCrossovers(const std::vector<FusedPair>& pairs) {
  std::vector<bool> crossover(pairs.size(), false);
  double widest = 0.1;
  for (const FusedPair& p : pairs) widest = std::max(widest, p.footprint_radius);
  // Squares so large that footprints which overlap are in the same or in touching ones.
  const double square = 2 * widest;
  const auto squareOf = [&](const FusedPair& p) {
    const Eigen::Vector3d at = p.T_nav_cam.translation();
    return std::pair{static_cast<long>(std::floor(at.x() / square)),
                     static_cast<long>(std::floor(at.y() / square))};
  };
  std::map<std::pair<long, long>, std::vector<std::size_t>> squares;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (pairs[k].footprint_radius > 0) squares[squareOf(pairs[k])].push_back(k);
  const auto overlap = [&](const FusedPair& a, const FusedPair& b) {
    const double apart = (a.T_nav_cam.translation() - b.T_nav_cam.translation()).head<2>().norm();
    return std::abs(a.pair.utc_ns - b.pair.utc_ns) > kComeBack &&
           apart < a.footprint_radius + b.footprint_radius;
  };
  for (const auto& [at, members] : squares) {
    for (const std::size_t k : members) {
      for (long dn = -1; dn <= 1 && !crossover[k]; ++dn) {
        for (long de = -1; de <= 1 && !crossover[k]; ++de) {
          const auto near = squares.find({at.first + dn, at.second + de});
          if (near == squares.end()) continue;
          crossover[k] = std::any_of(near->second.begin(), near->second.end(),
                                     [&](std::size_t other) { return overlap(pairs[k], pairs[other]); });
        }
      }
    }
  }
  return crossover;
}

}  // namespace fathom::topside
