#include "recon/topside/report/pose_output.hpp"

#include <algorithm>
#include <cmath>

#include "firmware_if/files/pose_files.hpp"
#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/localise/crossovers.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::topside {
namespace {

constexpr double kDrawing = 620;  // longer side of the map [px]

std::vector<Eigen::Vector2d> placesOf(const std::vector<NavigatedPose>& poses) {
  std::vector<Eigen::Vector2d> places;  // (east, north)
  for (const NavigatedPose& pose : poses)
    if (pose.T_nav_body)
      places.emplace_back(pose.T_nav_body->translation().y(), pose.T_nav_body->translation().x());
  return places;
}

double rmsOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return values.empty() ? 0 : std::sqrt(sum / static_cast<double>(values.size()));
}

}  // namespace

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

void writeClosures(const std::filesystem::path& path, const std::vector<ImagePair>& pairs,
                   const std::vector<slam::NavigationLink>& closures) {
  AtomicFile file(path);
  file.stream()
      << "left_a,left_b,x_m,y_m,z_m,qw,qx,qy,qz,sigma_position_m,sigma_rotation_rad,inliers,chi2,kept\n";
  for (const slam::NavigationLink& c : closures) {
    const Eigen::Vector3d& t = c.T_a_b.translation();
    const Eigen::Quaterniond& q = c.T_a_b.rotation();
    file.stream() << formatted("%s,%s,%.5f,%.5f,%.5f,%.8f,%.8f,%.8f,%.8f,%.5f,%.6f,%d,%.3f,%d\n",
                               pairs[c.a].left.c_str(), pairs[c.b].left.c_str(), t.x(), t.y(), t.z(), q.w(),
                               q.x(), q.y(), q.z(), std::sqrt(c.covariance.topLeftCorner<3, 3>().trace() / 3),
                               std::sqrt(c.covariance.bottomRightCorner<3, 3>().trace() / 3), c.inliers,
                               c.chi2, c.kept ? 1 : 0);
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

std::string tracksSvg(const std::vector<NavigatedPose>& reckoned, const SlamResult& slam) {
  const std::vector<Eigen::Vector2d> before = placesOf(reckoned), after = placesOf(slam.poses);
  if (before.empty()) return {};
  Eigen::Vector2d low = before.front(), high = low;
  for (const auto* places : {&before, &after})
    for (const Eigen::Vector2d& p : *places) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  const double margin = 0.04 * (high - low).maxCoeff() + 0.1;
  low.array() -= margin;
  high.array() += margin;
  PlotAxes axes;
  const double scale = kDrawing / (high - low).maxCoeff();
  axes.width = std::max(scale * (high - low).x(), 160.0);
  axes.height = std::max(scale * (high - low).y(), 160.0);
  axes.left = low.x();
  axes.right = high.x();
  axes.bottom = low.y();
  axes.top = high.y();
  axes.x_label = "east [m]";
  axes.y_label = "north [m]";
  axes.title = "tracks from above";
  SvgPlot plot(axes);
  plot.line(before, "#9aa5b1", 1.2, true);
  for (const slam::NavigationLink& c : slam.closures) {
    const auto &a = slam.poses[c.a].T_nav_body, &b = slam.poses[c.b].T_nav_body;
    if (!a || !b) continue;
    plot.segment({a->translation().y(), a->translation().x()}, {b->translation().y(), b->translation().x()},
                 c.kept ? "#2ca02c" : "#d62728", c.kept ? 0.5 : 1.2);
  }
  plot.line(after, "#1f77b4", 1.5);
  return plot.svg();
}

std::string closureErrorsSvg(const std::vector<double>& reckoned, const std::vector<double>& solved) {
  if (reckoned.empty()) return {};
  std::vector<double> sorted = reckoned;
  std::sort(sorted.begin(), sorted.end());
  const double most = std::max(sorted.back(), 0.01);
  constexpr int kBins = 40;
  return histogramSvg(reckoned, 0, most, kBins, "m",
                      "dead reckoning: rms " + fixedDigits(rmsOf(reckoned), 3) + " m") +
         histogramSvg(solved, 0, most, kBins, "m", "localised: rms " + fixedDigits(rmsOf(solved), 4) + " m");
}

}  // namespace fathom::topside
