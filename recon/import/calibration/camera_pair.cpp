#include "recon/import/calibration/camera_pair.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::topside {
namespace {

constexpr Eigen::Index kSamples = 200;  // between principal point and corner

// Of the side of an image, the part from the principal point to the farther edge [px].
double reach(double principal, int side) {
  constexpr double kSpare = 1.1;  // where the size is not known
  return side == 0 ? kSpare * principal : std::max(principal, side - principal);
}

}  // namespace

double fitRationalLens(Camera& camera, const std::array<double, 3>& d) {
  const Camera lens = camera;
  const auto distorted = [&](double r) {
    const double q = r * r;
    return r * (1 + q * (lens.k1 + q * (lens.k2 + q * lens.k3))) / (1 + q * (d[0] + q * (d[1] + q * d[2])));
  };
  const double corner =
      hypotenuse(reach(lens.cx, lens.width) / lens.fx, reach(lens.cy, lens.height) / lens.fy);
  // The undistorted radius of the corner: outwards in steps, as long as the image grows.
  const double step = corner / kSamples;
  double most = 0;
  while (distorted(most) < corner) {
    if (!(distorted(most + step) > distorted(most)) || most > 4 * corner)
      return std::numeric_limits<double>::infinity();
    most += step;
  }
  Eigen::Matrix<double, Eigen::Dynamic, 3> powers(kSamples, 3);
  Eigen::VectorXd shift(kSamples);
  for (Eigen::Index k = 0; k < kSamples; ++k) {
    const double s = static_cast<double>(k + 1) / kSamples;
    powers.row(k) << std::pow(s, 3), std::pow(s, 5), std::pow(s, 7);
    shift(k) = distorted(s * most) - s * most;
  }
  const Eigen::Vector3d fit = powers.colPivHouseholderQr().solve(shift);
  camera.k1 = fit(0) / std::pow(most, 3);
  camera.k2 = fit(1) / std::pow(most, 5);
  camera.k3 = fit(2) / std::pow(most, 7);
  return (powers * fit - shift).cwiseAbs().maxCoeff() * std::max(lens.fx, lens.fy);
}

namespace {

constexpr std::size_t kMostNumbers = 64;  // of one value
constexpr double kLargest = 1e6;          // of a focal length or principal point [px], a coefficient
constexpr double kMostOff = 0.1;          // a fit to a rational lens [px]; corners are found to about this
constexpr double kMaxImageSize = 65535;   // [px]
constexpr double kQuaternionTolerance = 1e-3;  // of its length from 1; real files carry six decimals

bool gather(const CalibrationTree& value, std::vector<double>& out) {
  if (value.is_array())
    return std::all_of(value.begin(), value.end(), [&](const auto& one) { return gather(one, out); });
  if (!value.is_number() || out.size() == kMostNumbers) return false;
  out.push_back(value.get<double>());
  return std::isfinite(out.back());
}

double sideOf(const CalibrationTree& matrix, const char* name) {
  const auto found = matrix.find(name);
  return found != matrix.end() && found->is_number() ? found->get<double>() : 0;
}

}  // namespace

void CalibrationPlace::fail(const std::string& fix) const {
  throw InputError(file.string(), key, fix);
}

std::optional<std::vector<double>> numbersOf(const CalibrationTree& value) {
  std::vector<double> out;
  if (!value.is_object()) {
    if (!gather(value, out)) return std::nullopt;
    return out;
  }
  const auto data = value.find("data");
  if (data == value.end() || !gather(*data, out)) return std::nullopt;
  if (sideOf(value, "rows") * sideOf(value, "cols") != static_cast<double>(out.size())) return std::nullopt;
  return out;
}

std::vector<double> numbersOf(const CalibrationTree& value, std::size_t count,
                              const CalibrationPlace& place) {
  const auto numbers = numbersOf(value);
  if (!numbers) place.fail("holds something else than " + std::to_string(count) + " finite numbers");
  if (numbers->size() != count)
    place.fail("holds " + std::to_string(numbers->size()) + " numbers, not " + std::to_string(count));
  return *numbers;
}

Camera cameraOf(const std::vector<double>& m, const CalibrationPlace& place) {
  if (m[1] != 0) place.fail("has a skew, which the camera model has not; calibrate without");
  if (m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1) place.fail("is not fx 0 cx, 0 fy cy, 0 0 1");
  Camera camera;
  camera.fx = m[0], camera.cx = m[2], camera.fy = m[4], camera.cy = m[5];
  if (!(camera.fx > 0 && camera.fx < kLargest && camera.fy > 0 && camera.fy < kLargest))
    place.fail("focal length must be positive, in pixels");
  if (!(std::abs(camera.cx) < kLargest && std::abs(camera.cy) < kLargest))
    place.fail("principal point must be in pixels");
  return camera;
}

double setDistortion(Camera& camera, const std::vector<double>& numbers, const CalibrationPlace& place) {
  constexpr std::array<std::size_t, 6> kCounts{0, 4, 5, 8, 12, 14};
  constexpr std::size_t kBrown = 5, kRational = 8;
  if (std::find(kCounts.begin(), kCounts.end(), numbers.size()) == kCounts.end())
    place.fail("holds " + std::to_string(numbers.size()) +
               " distortion coefficients; k1 k2 p1 p2 and perhaps k3 are known");
  const std::array<double*, kBrown> known{&camera.k1, &camera.k2, &camera.p1, &camera.p2, &camera.k3};
  std::array<double, kRational - kBrown> denominator{};
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    if (!(std::abs(numbers[k]) < kLargest)) place.fail("a distortion coefficient is too large");
    if (k < kBrown)
      *known[k] = numbers[k];
    else if (k < kRational)
      denominator[k - kBrown] = numbers[k];
    else if (numbers[k] != 0)
      place.fail("has coefficients of the thin prism or tilted model; calibrate with k1 k2 p1 p2 k3 alone");
  }
  if (denominator == decltype(denominator){}) return 0;
  const double off = fitRationalLens(camera, denominator);
  if (!(off < kMostOff))
    place.fail("is a rational lens that k1 k2 p1 p2 k3 cannot follow to " + decimals(kMostOff, 1) +
               " px; calibrate with these alone");
  return off;
}

void setSize(Camera& camera, const std::vector<double>& numbers, const CalibrationPlace& place) {
  for (const double side : numbers)
    if (!(side >= 1 && side <= kMaxImageSize) || side != std::floor(side))
      place.fail("image size is not a whole number of pixels from 1 to 65535");
  camera.width = static_cast<int>(numbers[0]);
  camera.height = static_cast<int>(numbers[1]);
}

SE3 motionOf(const std::vector<double>& rotation, const CalibrationPlace& rotation_place,
             const std::vector<double>& translation) {
  const Eigen::Vector3d t(translation.data());
  if (rotation.size() == 3) {
    const Eigen::Vector3d vector(rotation.data());
    const double angle = vector.norm();
    if (!(angle < 2 * M_PI)) rotation_place.fail("is no rotation vector in radians");
    return angle > 0 ? SE3(Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle)), t)
                     : SE3(Eigen::Quaterniond::Identity(), t);
  }
  const auto matrix = nearestRotation(
      Eigen::Matrix3d(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation.data())));
  if (!matrix) rotation_place.fail("is no rotation matrix");
  return {*matrix, t};
}

SE3 motionOf(const std::array<double, 4>& q, const Eigen::Vector3d& translation,
             const CalibrationPlace& place) {
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (!(std::abs(rotation.norm() - 1) < kQuaternionTolerance)) place.fail("is no unit quaternion w x y z");
  return {rotation, translation};
}

}  // namespace fathom::topside
