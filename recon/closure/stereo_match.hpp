#pragma once

#include <Eigen/Core>
#include <array>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::closure {

constexpr double kFlatVariance = 4.0;    // of a window without texture [grey levels^2]
constexpr double kMatchFloor_px = 0.03;  // least standard deviation of a match: interpolation, lens model

// First pixel of a row of an 8-bit mono image.
[[nodiscard]] const std::uint8_t* rowOf(const ImageView& image, int y);
// Whether an image holds the window of `reach` [px] about a pixel, and one pixel around it.
[[nodiscard]] bool holdsWindow(const ImageView& image, const Eigen::Vector2d& pixel, double reach);

// Finds the window about a pixel of one image in another image: Gauss-Newton on both coordinates with unknown
// gain and offset (Lucas & Kanade 1981; Baker & Matthews 2004, inverse compositional). Images: 8-bit mono.
class PatchAligner {
 public:
  // `window`: its edge [px], odd, at most kMostWindow; throws std::invalid_argument for another one.
  explicit PatchAligner(int window);

  // Sets the template: at offset d from its middle, the image at `centre` + `warp` d. False where that leaves
  // the image, where it has no texture, or where it is an edge, along which the position is not determined.
  [[nodiscard]] bool take(const ImageView& image, const Eigen::Vector2d& centre,
                          const Eigen::Matrix2d& warp = Eigen::Matrix2d::Identity());

  // Moves `at` to the template's position in `image`; covariance: s^2 H^-1 of the least-squares problem
  // [px^2]. False without convergence or beyond `most_shift` [px].
  [[nodiscard]] bool find(const ImageView& image, double most_shift, Eigen::Vector2d& at,
                          Eigen::Matrix2d& covariance) const;

  static constexpr int kMostWindow = 31;

 private:
  static constexpr std::size_t kMostValues = kMostWindow * kMostWindow;
  int half_, values_;
  std::array<double, kMostValues> model_;  // less its mean
  std::array<Eigen::Vector2d, kMostValues> gradient_;
  double power_ = 0;
  Eigen::Matrix2d inverse_;
};

// Limits of a point's depth [m].
struct DepthRange {
  double nearest = 0.5, farthest = 12.0;
};

struct StereoMatchConfig {
  int search_window = 11;              // edge of the correlation window [px], odd
  int refine_window = 15;              // edge of the window of the sub-pixel position [px], odd
  double min_correlation = 0.75;       // zero-mean normalised
  double max_second_peak = 0.95;       // best correlation elsewhere on the line over the best
  double max_epipolar_distance = 1.0;  // [px]
};

struct StereoMatch {
  Eigen::Vector2d right;       // distorted pixel
  Eigen::Matrix2d covariance;  // of it [px^2]
  Eigen::Vector3d point;       // left camera frame [m]
};

// Finds the right pixel of a left one: correlation of windows along the epipolar line through both lenses in
// steps of one pixel, then PatchAligner on both coordinates.
class StereoMatcher {
 public:
  StereoMatcher(const StereoRig& rig, const StereoMatchConfig& config) : rig_(rig), config_(config) {}

  // `left`, `right`: 8-bit mono, the rig's size.
  [[nodiscard]] bool match(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                           const DepthRange& depths, StereoMatch& found) const;

  // Covariance of the point of a match [m^2], first order (Hartley & Zisserman 2004, 5.2.1): the place of the
  // feature in the left image, of standard deviation `sigma_place` [px], moves both pixels alike; the match
  // moves the right one.
  [[nodiscard]] Eigen::Matrix3d pointCovariance(const Eigen::Vector2d& left_pixel, const StereoMatch& match,
                                                double sigma_place) const;

 private:
  [[nodiscard]] bool search(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                            const DepthRange& depths, Eigen::Vector2d& right_pixel) const;
  [[nodiscard]] bool refine(const ImageView& left, const ImageView& right, const Eigen::Vector2d& left_pixel,
                            StereoMatch& found) const;

  StereoRig rig_;
  StereoMatchConfig config_;
};

}  // namespace fathom::closure
