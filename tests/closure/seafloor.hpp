#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "recon/closure/feature_extractor.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// Synthetic seafloor: depth and brightness over north and east.
struct Seafloor {
  std::function<double(double, double)> depth;    // nav z [m]
  std::function<double(double, double)> texture;  // standard deviation about 1
};

// Band-limited random texture: cubic B-spline noise of five sizes from `finest` [m] upwards, without period
// within hundreds of metres.
[[nodiscard]] std::function<double(double, double)> randomTexture(double finest, std::uint32_t seed);

struct StereoImages {
  int width = 0, height = 0;
  std::vector<std::uint8_t> left, right;
  [[nodiscard]] ImageView leftView() const {
    return {left.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
  }
  [[nodiscard]] ImageView rightView() const {
    return {right.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
  }
};

// Both images, with noise of 2 grey levels that differs with `seed`; the right one at 0.85 of the brightness.
[[nodiscard]] StereoImages shoot(const Seafloor& seafloor, const StereoRig& rig, const SE3& T_nav_cam,
                                 std::uint32_t seed);

// A camera over a place, looking down, turned by yaw; roll and pitch in rad.
[[nodiscard]] SE3 lookingDown(double north, double east, double depth, double yaw, double roll = 0,
                              double pitch = 0);

// Up to 400 features of smallRig()'s images, as shoot() takes them.
[[nodiscard]] closure::FrameFeatures featuresOf(const Seafloor& seafloor, const SE3& T_nav_cam,
                                                std::uint32_t seed);

// A small rig with the lenses of a real one: 480 x 384 px, 7 cm baseline.
[[nodiscard]] StereoRig smallRig();

}  // namespace fathom::test
