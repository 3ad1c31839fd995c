#include "recon/topside/localise/ground_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace fathom::topside {
namespace {

constexpr double kFarthestPixel = 2.5;  // of the plane's distance; beyond, a pixel covers too much ground

// Zero-padded to `size`, as a spectrum.
cv::Mat spectrum(const cv::Mat& values, const cv::Size& size) {
  cv::Mat padded = cv::Mat::zeros(size, CV_32F), out;
  values.copyTo(padded(cv::Rect(0, 0, values.cols, values.rows)));
  cv::dft(padded, out, 0, values.rows);
  return out;
}

// Sums over x of a(x + d) b(x) at every d, wrapped around.
cv::Mat correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat product, out;
  cv::mulSpectrums(a, b, product, 0, true);
  cv::dft(product, out, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
  return out;
}

struct Spectra {
  Spectra(const GroundPicture& picture, const cv::Size& size)
      : seen(spectrum(picture.seen, size)),
        values(spectrum(picture.values, size)),
        squares(spectrum(picture.values.mul(picture.values), size)) {}
  cv::Mat seen, values, squares;
};

}  // namespace

SE3 GroundPlane::T_cam_ground() const {
  Eigen::Vector3d north = -Eigen::Vector3d::UnitY();
  if (std::abs(north.dot(normal)) > 0.99) north = Eigen::Vector3d::UnitZ();
  north = (north - north.dot(normal) * normal).normalized();
  Eigen::Matrix3d R;
  R.col(0) = north;
  R.col(1) = normal.cross(north);
  R.col(2) = normal;
  return {R, distance * normal};
}

std::optional<Eigen::Vector3d> GroundPlane::under(const Eigen::Vector3d& ray, double farthest) const {
  const double along = normal.dot(ray);
  if (!(along > 0)) return std::nullopt;
  const Eigen::Vector3d point = distance / along * ray;
  if (point.norm() > farthest * distance) return std::nullopt;
  return point;
}

cv::Mat evenContrast(const cv::Mat& mono, int widest, Camera& camera) {
  int shrink = 1;
  while (camera.width / shrink > widest) shrink *= 2;
  cv::Mat small, mean, spread, out;
  cv::resize(mono, small, {camera.width / shrink, camera.height / shrink}, 0, 0, cv::INTER_AREA);
  camera = camera.scaled(1.0 / shrink);
  small.convertTo(small, CV_32F);
  constexpr double kNoise = 1.0, kWindow = 1.0 / 24;  // standard deviations: [px]; of the image's width
  cv::GaussianBlur(small, small, {}, kNoise);
  const double window = kWindow * small.cols;
  cv::GaussianBlur(small, mean, {}, window);
  out = small - mean;
  cv::GaussianBlur(out.mul(out), spread, {}, window);
  constexpr double kLeast = 0.5, kMost = 3.0;  // contrast, grey levels; values
  cv::sqrt(spread + kLeast * kLeast, spread);
  cv::divide(out, spread, out);
  return cv::min(cv::max(out, -kMost), kMost);
}

GroundPicture layOut(const cv::Mat& even, const Camera& camera, const GroundPlane& plane, double cell,
                     double turn) {
  const SE3 T_cam_ground = plane.T_cam_ground();
  const SE3 T_ground_cam = T_cam_ground.inverse();
  const Eigen::Rotation2Dd R(turn);
  Eigen::AlignedBox2d box;
  constexpr int kSteps = 16;
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; j <= kSteps; ++j)
      if (const auto point =
              plane.under(camera.ray({(camera.width - 1.0) * i / kSteps, (camera.height - 1.0) * j / kSteps}),
                          kFarthestPixel))
        box.extend(Eigen::Vector2d(R * (T_ground_cam * *point).head<2>()));
  GroundPicture out;
  out.cell = cell;
  if (box.isEmpty()) return out;
  out.corner = box.min();
  constexpr int kMost = 1024;  // cells along a side
  const Eigen::Vector2d extent = box.sizes() / cell;
  const int rows = std::min(kMost, static_cast<int>(extent.x()) + 1);
  const int columns = std::min(kMost, static_cast<int>(extent.y()) + 1);
  cv::Mat x(rows, columns, CV_32F), y(rows, columns, CV_32F);
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      const Eigen::Vector2d g = R.inverse() * Eigen::Vector2d(out.corner + cell * Eigen::Vector2d(i, j));
      const Eigen::Vector3d p = T_cam_ground * Eigen::Vector3d(g.x(), g.y(), 0);
      Eigen::Vector2d pixel(-1, -1);
      if (p.z() > 0 && p.norm() <= kFarthestPixel * plane.distance) pixel = camera.project(p);
      if (!camera.contains(pixel)) pixel = {-1, -1};
      x.at<float>(i, j) = static_cast<float>(pixel.x());
      y.at<float>(i, j) = static_cast<float>(pixel.y());
    }
  cv::remap(even, out.values, x, y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::Mat inside = x >= 0;
  inside.convertTo(out.seen, CV_32F, 1.0 / 255);
  out.values = out.values.mul(out.seen);
  return out;
}

GroundMatch correlate(const GroundPicture& a, const GroundPicture& b, double least_overlap) {
  GroundMatch best;
  if (a.values.empty() || b.values.empty()) return best;
  const cv::Size size(cv::getOptimalDFTSize(a.values.cols + b.values.cols),
                      cv::getOptimalDFTSize(a.values.rows + b.values.rows));
  const Spectra of_a(a, size), of_b(b, size);
  const cv::Mat common = correlation(of_a.seen, of_b.seen);
  const cv::Mat sum_a = correlation(of_a.values, of_b.seen), sum_b = correlation(of_a.seen, of_b.values);
  const cv::Mat squares_a = correlation(of_a.squares, of_b.seen),
                squares_b = correlation(of_a.seen, of_b.squares);
  const cv::Mat products = correlation(of_a.values, of_b.values);
  const double least = least_overlap * std::min(cv::sum(a.seen)[0], cv::sum(b.seen)[0]);
  for (int i = 0; i < size.height; ++i)
    for (int j = 0; j < size.width; ++j) {
      const auto n = static_cast<double>(common.at<float>(i, j));
      if (n < std::max(least, 1.0)) continue;
      const auto sa = static_cast<double>(sum_a.at<float>(i, j)),
                 sb = static_cast<double>(sum_b.at<float>(i, j));
      const double va = static_cast<double>(squares_a.at<float>(i, j)) - sa * sa / n;
      const double vb = static_cast<double>(squares_b.at<float>(i, j)) - sb * sb / n;
      constexpr double kFlat = 1e-3;  // variance of a cell
      if (va < kFlat * n || vb < kFlat * n) continue;
      const double c = (static_cast<double>(products.at<float>(i, j)) - sa * sb / n) / std::sqrt(va * vb);
      if (c <= best.correlation) continue;
      best.correlation = c;
      const Eigen::Vector2d cells(i >= a.values.rows ? i - size.height : i,
                                  j >= a.values.cols ? j - size.width : j);
      best.shift = a.corner - b.corner + a.cell * cells;
    }
  return best;
}

}  // namespace fathom::topside
