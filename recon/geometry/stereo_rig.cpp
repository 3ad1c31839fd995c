#include "recon/geometry/stereo_rig.hpp"

#include <cmath>
#include <fstream>
#include <iomanip>
#include <string>
#include <vector>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/nearest_rotation.hpp"

namespace fathom {
namespace {

constexpr double kMaxImageSize = 65535;      // [px]
constexpr double kLeftPoseTolerance = 1e-3;  // of the left camera's own rotation [rad] and translation [m]
constexpr double kMaxBaseline = 100.0;       // [m]

std::vector<double> readNumbers(const std::filesystem::path& path) {
  std::ifstream in(path);
  std::error_code error;
  if (!in || std::filesystem::is_directory(path, error))
    throw InputError(path, "", "cannot be read; give a stereo.calib");
  std::vector<double> numbers;
  std::string token;
  while (in >> token) {
    std::size_t used = 0;
    double value = 0.0;
    try {
      value = std::stod(token, &used);
    } catch (const std::exception&) {
      used = 0;
    }
    if (used != token.size() || !std::isfinite(value))
      throw InputError(path, "number " + std::to_string(numbers.size() + 1),
                       "'" + token.substr(0, 40) + "' is not a number");
    numbers.push_back(value);
  }
  return numbers;
}

// Takes the numbers of one file in order; remembers the place for error lines.
class Cursor {
 public:
  Cursor(const std::filesystem::path& path, const std::vector<double>& numbers)
      : path_(path), numbers_(numbers) {}
  double next() { return numbers_[index_++]; }
  [[noreturn]] void fail(const std::string& fix) const {
    throw InputError(path_, "number " + std::to_string(index_), fix);
  }

 private:
  const std::filesystem::path& path_;
  const std::vector<double>& numbers_;
  std::size_t index_ = 0;
};

Camera readCamera(Cursor& in, bool with_k3, SE3& T_cam_left) {
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
  const std::vector<double> numbers = readNumbers(path);
  const std::size_t n = numbers.size();
  if (n != 55 && n != 57 && n != 100)
    throw InputError(path, "", "holds " + std::to_string(n) + " numbers; a stereo.calib has 55, 57 or 100");
  Cursor in(path, numbers);
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
  return rig;
}

void writeStereoCalib(const std::filesystem::path& path, const StereoRig& rig) {
  const bool with_k3 = rig.left.k3 != 0 || rig.right.k3 != 0;
  AtomicFile file(path);
  file.stream() << std::setprecision(17) << "2\n";
  writeCamera(file.stream(), rig.left, SE3(), with_k3);
  writeCamera(file.stream(), rig.right, rig.T_right_left, with_k3);
  file.commit();
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

}  // namespace fathom
