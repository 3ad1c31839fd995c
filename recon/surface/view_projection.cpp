#include "recon/surface/view_projection.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace fathom::surface {
namespace {

// Normalised radius beyond which nothing is projected: 1.3 times the farthest corner's, cut where the radial
// distortion stops growing.
double farthestRadius(const Camera& camera) {
  constexpr double kBeyond = 1.3, kSteps = 256;
  double corner = 0;
  for (const double u : {0.0, camera.width - 1.0})
    for (const double v : {0.0, camera.height - 1.0})
      corner = std::max(corner, camera.undistort({u, v}).norm());
  double last = 0, radius = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = kBeyond * corner * i / kSteps, r2 = r * r;
    const double image = r * (1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3)));
    if (image <= last) break;
    last = image;
    radius = r;
  }
  return radius;
}

}  // namespace

ViewProjection::ViewProjection(const Camera& camera, const SE3& T_nav_cam, const Eigen::Vector3d& origin)
    : fx(static_cast<float>(camera.fx)),
      fy(static_cast<float>(camera.fy)),
      cx(static_cast<float>(camera.cx)),
      cy(static_cast<float>(camera.cy)),
      k1(static_cast<float>(camera.k1)),
      k2(static_cast<float>(camera.k2)),
      p1(static_cast<float>(camera.p1)),
      p2(static_cast<float>(camera.p2)),
      k3(static_cast<float>(camera.k3)),
      width(static_cast<float>(camera.width)),
      height(static_cast<float>(camera.height)) {
  const SE3 T_cam_nav = T_nav_cam.inverse();
  Eigen::Matrix3d r = T_cam_nav.matrix3();
  Eigen::Vector3d t = T_cam_nav * origin;
  if (camera.port) {
    const Eigen::Matrix3d port =
        Eigen::Quaterniond::FromTwoVectors(camera.port->normal, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    r = port * r;
    t = port * t;
    takePort(*camera.port, port);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j)
      rotation[3 * i + j] = static_cast<float>(r(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
    translation[i] = static_cast<float>(t[static_cast<Eigen::Index>(i)]);
  }
  const double radius = farthestRadius(camera);
  limit = static_cast<float>(radius * radius);
}

void ViewProjection::takePort(const FlatPort& port, const Eigen::Matrix3d& R_port_cam) {
  const Camera& lens = port.air;
  ported = true;
  fx = static_cast<float>(lens.fx), fy = static_cast<float>(lens.fy);
  cx = static_cast<float>(lens.cx), cy = static_cast<float>(lens.cy);
  k1 = static_cast<float>(lens.k1), k2 = static_cast<float>(lens.k2), k3 = static_cast<float>(lens.k3);
  p1 = static_cast<float>(lens.p1), p2 = static_cast<float>(lens.p2);
  for (int i = 0; i < 9; ++i)
    into_lens[static_cast<std::size_t>(i)] = static_cast<float>(R_port_cam(i % 3, i / 3));  // transposed
  gap = static_cast<float>(port.distance);
  glass = static_cast<float>(port.glass);
  bend_water = static_cast<float>(port.water_index * port.water_index - 1);
  index_water = static_cast<float>(port.water_index);
  slow_glass = static_cast<float>(port.water_index / port.glass_index);
  const double in_air = farthestRadius(lens);
  air_limit = static_cast<float>(in_air * in_air);
}

bool ViewProjection::mayMeet(const Eigen::Vector3f& middle, float radius) const {
  const auto along = [&](std::size_t row) {
    return rotation[3 * row] * middle.x() + rotation[3 * row + 1] * middle.y() +
           rotation[3 * row + 2] * middle.z() + translation[row];
  };
  const float x = along(0), y = along(1), z = depthOf(middle);
  if (z < -radius) return false;
  if (z < 2 * radius + kNear) return true;  // too near for the bounds below
  // The sphere spans at most `angle` around its middle in normalised coordinates. The distortion that grows
  // towards the corners stretches that by no more than twice.
  const float a = x / z, b = y / z, off2 = a * a + b * b;
  const float angle = radius / (z - radius) * (1 + off2);
  const float far = std::sqrt(limit) + angle;
  if (off2 > far * far) return false;
  const Pixel pixel = project(middle.x(), middle.y(), middle.z());
  if (!pixel.valid) return true;
  const float reach = 2 * std::max(fx, fy) * index_water * angle;
  return pixel.u > -reach && pixel.v > -reach && pixel.u < width + reach && pixel.v < height + reach;
}

}  // namespace fathom::surface
