#include "recon/products/exports/sparse_model.hpp"

#include <limits>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {

SE3 worldFromNav() {
  Eigen::Matrix3d R;
  R << 0, 1, 0, 1, 0, 0, 0, 0, -1;  // east, north, up of north, east, down
  return {R, Eigen::Vector3d::Zero()};
}

std::string originText(const SparseModel& model) {
  if (!model.origin)
    return "World: x east, y north, z up [m]; nobody says where on the Earth: placed by: none\n";
  const double latitude = model.origin->latitude * kDegreesPerRadian,
               longitude = model.origin->longitude * kDegreesPerRadian;
  return formatted(
      "World: x east, y north, z up [m]; z is minus the depth.\n"
      "Origin (WGS84): latitude %.9f, longitude %.9f, placed by: %s\n"
      "x and y as a coordinate system: +proj=tmerc +lat_0=%.9f +lon_0=%.9f +k=1 +x_0=0 +y_0=0 +datum=WGS84 "
      "+units=m +no_defs\n",
      latitude, longitude, model.placed_by.c_str(), latitude, longitude);
}

double SparseModel::meanError() const {
  double sum = 0;
  for (const SparsePoint& point : points) sum += static_cast<double>(point.error) * point.views;
  return members.empty() ? 0 : sum / static_cast<double>(members.size());
}

std::array<double, 2> pixelErrors(const StereoRig& rig, const SE3& T_world_cam,
                                  const closure::Feature& feature, const Eigen::Vector3d& place) {
  const Eigen::Vector3d left = T_world_cam.inverse() * place, right = rig.T_right_left * left;
  constexpr double kNever = std::numeric_limits<double>::infinity();
  if (left.z() <= 0 || right.z() <= 0) return {kNever, kNever};
  return {(rig.left.project(left) - feature.left.cast<double>()).norm(),
          (rig.right.project(right) - feature.right.cast<double>()).norm()};
}

}  // namespace fathom::topside
