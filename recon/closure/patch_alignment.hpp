#pragma once

#include <Eigen/Core>
#include <array>

#include "recon/geometry/image_view.hpp"

namespace fathom::closure {

// Where another image shows what is about a pixel of this one: Gauss-Newton on both coordinates with unknown
// gain and offset (Lucas & Kanade 1981; Baker & Matthews 2004, inverse compositional). Images: 8-bit mono.
class PatchAligner {
 public:
  // `window`: its edge [px], odd, at most kMostWindow; throws std::invalid_argument for another one.
  explicit PatchAligner(int window);

  // What to look for: at offset d from its middle, the image at `centre` + `warp` d. False where that leaves
  // the image, where it has no texture, or where it is an edge, which has no place along itself.
  [[nodiscard]] bool take(const ImageView& image, const Eigen::Vector2d& centre,
                          const Eigen::Matrix2d& warp = Eigen::Matrix2d::Identity());

  // Moves `at` to where `image` shows it; covariance: s^2 H^-1 of the least-squares problem [px^2]. False
  // where that is further than `most_shift` [px] away, or is not found.
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
