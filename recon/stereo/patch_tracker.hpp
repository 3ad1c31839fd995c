#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "recon/stereo/gray_pyramid.hpp"

namespace fathom::stereo {

struct PatchMatch {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  // in the target image [px]
  double correlation = 0;  // zero-mean normalised, of the windows at the full resolution, -1 to 1
  bool found = false;
};

// Finds the window about a point of one image in another whose brightness differs by an unknown gain and
// offset (left and right see other strobe paths and have other noise).
//
// Lucas-Kanade in the inverse compositional form (Baker & Matthews 2004), translation only, with gain and
// offset projected out of the template's gradient: s = w (grad T - parts along T and 1). As s is then
// orthogonal to every a T + b, the update is d = -H^-1 sum(s I(x + p)) / a with H = sum(s grad T) and a =
// sum(T I) / sum(T T): linear in the target, so that interpolation, which lowers the noise between pixels,
// draws no match towards half pixels. On the way down a pyramid; at the top the start is the best of the
// given candidates by correlation.
class PatchTracker {
 public:
  static constexpr int kMinWindow = 7, kMaxWindow = 31;  // [px]

  // `window`: edge [px], odd, kMinWindow to kMaxWindow.
  explicit PatchTracker(int window);

  // `at`: in level 0 of `source`; `candidates`: in level 0 of `target`, in the order along a curve, about one
  // top level pixel apart. Both pyramids have the same number of levels.
  [[nodiscard]] PatchMatch track(const GrayPyramid& source, const Eigen::Vector2d& at,
                                 const GrayPyramid& target, std::span<const Eigen::Vector2d> candidates);

 private:
  static constexpr int kMaxSamples = kMaxWindow * kMaxWindow;
  // The window of the source at one level, its statistics and steepest descent images.
  struct Template {
    std::array<float, kMaxSamples> value, sx, sy;  // value: weighted, minus its weighted mean
    Eigen::Matrix2d inverse_hessian;
    double energy = 0;  // weighted sum of squares about the mean
  };

  [[nodiscard]] bool makeTemplate(const GrayLevel& level, const Eigen::Vector2d& at);
  void sample(const GrayLevel& level, const Eigen::Vector2d& at, int edge, float* out) const;
  // Zero-mean normalised correlation of a sampled window with the template.
  [[nodiscard]] double correlation(const float* values) const;
  [[nodiscard]] Eigen::Vector2d search(const GrayLevel& level, double scale,
                                       std::span<const Eigen::Vector2d> candidates, double& best);
  [[nodiscard]] bool refine(const GrayLevel& level, Eigen::Vector2d& at, int iterations, double tolerance,
                            double& likeness);
  [[nodiscard]] bool inside(const GrayLevel& level, const Eigen::Vector2d& at) const;

  int window_, half_;
  std::array<float, kMaxSamples> weight_;  // Gaussian, sum 1
  Template template_;
  std::array<float, (kMaxWindow + 2) * (kMaxWindow + 2)> patch_;
};

}  // namespace fathom::stereo
