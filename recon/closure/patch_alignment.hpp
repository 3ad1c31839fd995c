#pragma once

#include <Eigen/Core>
#include <array>

#include "recon/geometry/image_view.hpp"

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

}  // namespace fathom::closure
