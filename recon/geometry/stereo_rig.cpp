#include "recon/geometry/stereo_rig.hpp"

#include <cmath>
#include <iomanip>
#include <string>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom {
namespace {

constexpr double kMaxImageSize = 65535;      // [px]
constexpr double kLeftPoseTolerance = 1e-3;  // of the left camera's own rotation [rad] and translation [m]
constexpr double kMaxBaseline = 100.0;       // [m]

Camera readCamera(NumberFile& in, bool with_k3, SE3& T_cam_left) {
  Camera c;
  for (int* side : {&c.width, &c.height}) {
    const double size = in.next();
    if (!(size >= 1 && size <= kMaxImageSize) || size != std::floor(size))
      in.fail("image size " + std::to_string(size) + " is not a whole number of pixels from 1 to 65535");
    *side = static_cast<int>(size);
  }
  double k[9];
  for (double& v : k) v = in.next();
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    in.fail("camera matrix is not fx 0 cx 0 fy cy 0 0 1");
  if (!(k[0] > 0 && k[4] > 0)) in.fail("focal length must be positive");
  c.fx = k[0], c.cx = k[2], c.fy = k[4], c.cy = k[5];
  c.k1 = in.next(), c.k2 = in.next(), c.p1 = in.next(), c.p2 = in.next();
  if (with_k3) c.k3 = in.next();
  Eigen::Matrix3d r;
  for (int i = 0; i < 9; ++i) r(i / 3, i % 3) = in.next();
  const auto rotation = nearestRotation(r);
  if (!rotation) in.fail("the nine numbers up to here are no rotation matrix");
  Eigen::Vector3d t;
  for (int i = 0; i < 3; ++i) t(i) = in.next();
  T_cam_left = SE3(*rotation, t);
  return c;
}

void writeCamera(std::ostream& out, const Camera& c, const SE3& T_cam_left, bool with_k3) {
  out << c.width << ' ' << c.height << ' ' << c.fx << " 0 " << c.cx << " 0 " << c.fy << ' ' << c.cy
      << " 0 0 1 " << c.k1 << ' ' << c.k2 << ' ' << c.p1 << ' ' << c.p2;
  if (with_k3) out << ' ' << c.k3;
  const Eigen::Matrix3d r = T_cam_left.matrix3();
  for (int i = 0; i < 9; ++i) out << ' ' << r(i / 3, i % 3);
  for (int i = 0; i < 3; ++i) out << ' ' << T_cam_left.translation()(i);
  out << '\n';
}

}  // namespace

StereoRig readStereoCalib(const std::filesystem::path& path) {
  NumberFile in(path, "a stereo.calib");
  const std::size_t n = in.count();
  if (n != 55 && n != 57 && n != 100)
    throw InputError(path, "", "holds " + std::to_string(n) + " numbers; a stereo.calib has 55, 57 or 100");
  if (in.next() != 2) in.fail("number of cameras must be 2");
  const bool with_k3 = n != 55;
  StereoRig rig;
  SE3 T_left_left;
  rig.left = readCamera(in, with_k3, T_left_left);
  if (T_left_left.log().norm() > kLeftPoseTolerance)
    in.fail("the left camera must come first, with identity rotation and zero translation");
  rig.right = readCamera(in, with_k3, rig.T_right_left);
  if (!(rig.baseline() > 0 && rig.baseline() < kMaxBaseline))
    in.fail("baseline of " + std::to_string(rig.baseline()) + " m cannot be; translations are in metres");
  readPorts(path, rig);
  return rig;
}

void writeStereoCalib(const std::filesystem::path& path, const StereoRig& rig) {
  const Camera& left = rig.left.port ? rig.left.port->air : rig.left;
  const Camera& right = rig.right.port ? rig.right.port->air : rig.right;
  const bool with_k3 = left.k3 != 0 || right.k3 != 0;
  AtomicFile file(path);
  file.stream() << std::setprecision(17) << "2\n";
  writeCamera(file.stream(), left, SE3(), with_k3);
  writeCamera(file.stream(), right, rig.T_right_left, with_k3);
  file.commit();
  writePorts(path, rig);
}

bool triangulateMidpoint(const StereoRig& rig, const Eigen::Vector3d& left_ray,
                         const Eigen::Vector3d& right_ray, Eigen::Vector3d& point, double& gap) {
  const SE3 T_left_right = rig.T_right_left.inverse();
  const Eigen::Vector3d& b = T_left_right.translation();
  const Eigen::Vector3d u = left_ray.normalized();
  const Eigen::Vector3d v = (T_left_right.rotation() * right_ray).normalized();
  const double uv = u.dot(v);
  const double denominator = 1.0 - uv * uv;
  constexpr double kParallel = 1e-12;
  if (denominator < kParallel) return false;
  const double s = (u.dot(b) - uv * v.dot(b)) / denominator;
  const double t = (uv * u.dot(b) - v.dot(b)) / denominator;
  if (s <= 0 || t <= 0) return false;
  const Eigen::Vector3d p = s * u, q = b + t * v;
  point = 0.5 * (p + q);
  gap = (p - q).norm();
  return true;
}

bool triangulatePixels(const StereoRig& rig, const Eigen::Vector2d& left, const Eigen::Vector2d& right,
                       Eigen::Vector3d& point, double& gap) {
  if (!rig.left.port && !rig.right.port)
    return triangulateMidpoint(rig, rig.left.ray(left), rig.right.ray(right), point, gap);
  Eigen::Vector3d found(0, 0, kPortDepth);
  constexpr int kIterations = 3;  // each takes the depth's error times a port's distance over the depth
  for (int i = 0; i < kIterations; ++i) {
    const double right_depth = (rig.T_right_left * found).z();
    if (!(right_depth > 0) || !triangulateMidpoint(rig, rig.left.ray(left, found.z()),
                                                   rig.right.ray(right, right_depth), found, gap))
      return false;
  }
  point = found;
  return true;
}

RayPair raysOf(const StereoRig& rig, const Eigen::Vector2d& left, const Eigen::Vector2d& right) {
  Eigen::Vector3d point;
  double gap = 0;
  if ((rig.left.port || rig.right.port) && triangulatePixels(rig, left, right, point, gap))
    return {rig.left.ray(left, point.z()), rig.right.ray(right, (rig.T_right_left * point).z())};
  return {rig.left.ray(left), rig.right.ray(right)};
}

}  // namespace fathom
