#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>

#include "recon/stereo/gray_pyramid.hpp"
#include "recon/stereo/kernels/kernels.hpp"

namespace fathom::stereo {

struct PatchMatch {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  // in the target image [px]
  // Of the position, from the windows' difference [px^2].
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  double correlation = 0;  // zero-mean normalised, of the windows at the full resolution, -1 to 1
  bool found = false;
};

// Finds the window about a point of one image in another that differs in brightness by an unknown gain and
// offset (the strobes' light paths and the noise of left and right differ).
//
// Lucas-Kanade in the inverse compositional form (Baker & Matthews 2004), translation only, with gain and
// offset projected out of the template's gradient: s = w (grad T - parts along T and 1). As s is then
// orthogonal to every a T + b, the update is d = -H^-1 sum(s I(x + p)) / a with H = sum(s grad T) and a =
// sum(T I) / sum(T T): linear in the target, so that interpolation, which lowers the noise between pixels,
// draws no match towards half pixels. It runs down a pyramid, from the candidate with the best correlation at
// the top. The window's forms are kept in 16-bit whole numbers, the sums are exact.
//
// Covariance: the update is linear in the difference r of the windows, which holds the noise of both images.
// With independent noise of variance v / a^2 (in the template's brightness), d has the covariance
// H^-1 M H^-1 v / a^2, M = sum(s s^T); v is the weighted mean square of r, v / a^2 = E (1 - c^2) / c^2 for
// the template's energy E and the correlation c.
class PatchTracker {
 public:
  static constexpr int kMinWindow = 7, kMaxWindow = 31;  // [px]
  static constexpr int kFineIterations = 12;             // at the full resolution at most; 3 to 5 are usual
  static constexpr int kCoarseIterations = 5;            // at each other level at most

  // `window`: edge [px], odd, kMinWindow to kMaxWindow.
  PatchTracker(int window, const Kernels& kernels);
  PatchTracker(const PatchTracker&) = delete;
  PatchTracker& operator=(const PatchTracker&) = delete;

  // `at`: in level 0 of `source`; `candidates`: in level 0 of `target`, in the order along a curve, about one
  // top level pixel apart. Both pyramids have the same number of levels. `finest`: the level that the match
  // is made at; it is given in level 0 all the same.
  [[nodiscard]] PatchMatch track(const GrayPyramid& source, const Eigen::Vector2d& at,
                                 const GrayPyramid& target, std::span<const Eigen::Vector2d> candidates,
                                 int finest = 0);

  // The same at one level alone, from a start within about a pixel, both in its pixels.
  [[nodiscard]] PatchMatch polish(const GrayLevel& source, const Eigen::Vector2d& at, const GrayLevel& target,
                                  const Eigen::Vector2d& start);

 private:
  static constexpr int kMaxPitch = 32;
  using Forms = std::array<std::int16_t, kMaxWindow * kMaxPitch>;
  // The window of the source at one level: linear forms of the samples, and the values that they are
  // derived from.
  struct Template {
    alignas(64) Forms value, sx, sy;
    Eigen::Matrix2d inverse_hessian;               // of samples [px^2 / sample^2]
    Eigen::Matrix2d spread;                        // M [sample^2 / px^2]
    double energy = 0;                             // weighted mean square about the mean [sample^2]
    double scale_v = 0, scale_x = 0, scale_y = 0;  // of the rounded forms
    double value_energy = 0;                       // sum of value times sample
    double along_x = 0, along_y = 0;  // sums of sx, sy times sample, over value_energy: what rounding left
    int centre = 0;                   // about the mean sample
  };
  struct Place;  // a window's position on the lattice of samples

  [[nodiscard]] bool makeTemplate(const GrayLevel& level, const Eigen::Vector2d& at);
  [[nodiscard]] Place placeOf(const GrayLevel& level, const Eigen::Vector2d& at) const;
  [[nodiscard]] double correlation(const GrayLevel& level, const Eigen::Vector2d& at) const;
  [[nodiscard]] Eigen::Vector2d search(const GrayLevel& level, double scale,
                                       std::span<const Eigen::Vector2d> candidates, double& best);
  [[nodiscard]] bool refine(const GrayLevel& level, Eigen::Vector2d& at, int iterations,
                            double tolerance) const;
  void finish(const GrayLevel& target, const Eigen::Vector2d& position, PatchMatch& match) const;
  [[nodiscard]] bool inside(const GrayLevel& level, const Eigen::Vector2d& at) const;

  const Kernels* kernels_;
  int half_;
  PatchShape shape_;
  double form_scale_;  // largest scale of a form of unscaled norm 1
  alignas(64) std::array<float, kMaxWindow * kMaxPitch> weight_;  // Gaussian, sum 1
  alignas(64) Forms search_weight_;
  double search_weight_sum_ = 0;
  Template template_;
  alignas(64) std::array<std::int16_t, (kMaxWindow + 2) * kPaddedPitch + 32> padded_;
};

}  // namespace fathom::stereo
