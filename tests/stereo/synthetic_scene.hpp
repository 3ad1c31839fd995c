#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// A sheet of textured surface, z = height(x, y) in the left camera frame [m], where present(x, y).
struct Sheet {
  std::function<double(double, double)> height;
  std::function<bool(double, double)> present = [](double, double) { return true; };
};

// What a camera makes of the light: value = gain * texture + offset + noise, in 8 bits.
struct Exposure {
  double gain = 1.0;
  double offset = 0.0;  // [grey levels]
  double noise = 2.0;   // standard deviation [grey levels]
};

struct GrayImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
  [[nodiscard]] ImageView view() const {
    return {pixels.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
  }
};

// Sheets under a stereo rig, painted with band-limited random texture: the sum of cubic B-spline noise of
// several sizes from `finest` [m] upwards. Images are made by following each pixel's ray, through the lens,
// to the nearest sheet.
class SyntheticScene {
 public:
  SyntheticScene(StereoRig rig, std::vector<Sheet> sheets, double finest = 0.003, std::uint32_t seed = 1);

  [[nodiscard]] std::pair<GrayImage, GrayImage> render(const Exposure& left, const Exposure& right) const;
  // Point seen by a left pixel, in the left camera frame; false where there is none.
  [[nodiscard]] bool pointAt(const Eigen::Vector2d& left_pixel, Eigen::Vector3d& point,
                             int* sheet = nullptr) const;
  // Right pixel of the same point.
  [[nodiscard]] Eigen::Vector2d rightPixel(const Eigen::Vector3d& point) const;
  [[nodiscard]] const StereoRig& rig() const { return rig_; }

 private:
  [[nodiscard]] bool intersect(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray,
                               Eigen::Vector3d& point, int& sheet) const;
  [[nodiscard]] double texture(double x, double y, int sheet) const;
  [[nodiscard]] GrayImage shoot(const Camera& camera, const SE3& T_left_camera, const Exposure& exposure,
                                std::uint32_t seed) const;

  StereoRig rig_;
  std::vector<Sheet> sheets_;
  double finest_;
  std::vector<float> lattice_;
};

// The middle of a real rig's images (ACFR, 1360x1024, 7 cm baseline, strong distortion): same lenses,
// smaller chip.
[[nodiscard]] StereoRig croppedRig(int width, int height);

}  // namespace fathom::test
