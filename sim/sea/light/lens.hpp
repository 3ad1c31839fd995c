#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// The rays of every pixel of a distorted camera under water, in the camera frame; behind a flat port traced
// through both faces of the glass by Snell's law.
class CameraRays {
 public:
  explicit CameraRays(const Camera& camera);
  // (x/z, y/z) through the centre of pixel (x, y).
  [[nodiscard]] const Eigen::Vector2f& at(int x, int y) const {
    return rays_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                 static_cast<std::size_t>(x)];
  }
  // Likewise, (dx, dy) pixels off the centre, |dx|, |dy| < 1: from the change between neighbours.
  [[nodiscard]] Eigen::Vector2f near(int x, int y, float dx, float dy) const;
  // Where that ray enters the water [m]; the camera's centre without a port.
  [[nodiscard]] Eigen::Vector3f origin(int x, int y) const {
    if (origins_.empty()) return Eigen::Vector3f::Zero();
    return origins_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                    static_cast<std::size_t>(x)];
  }

 private:
  int width_, height_;
  std::vector<Eigen::Vector2f> rays_;
  std::vector<Eigen::Vector3f> origins_;  // behind a port
};

// An image with `channels` interleaved channels, blurred in place by the functions below.
struct BlurImage {
  std::vector<float>& values;
  int width, height, channels;
};

// Gaussian blur in place; edges repeat.
void blur(const BlurImage& image, double sigma_px);

// Motion blur: the mean along the path of the scene during the exposure; `shift` gives the motion at a pixel
// [px].
void motionBlur(const BlurImage& image, const std::function<Eigen::Vector2f(int x, int y)>& shift);

// Defocus: a point at 1/r makes a disc of aperture * focal |1/r - 1/focus| pixels across (thin lens); nothing
// for a point aperture. `inverse_range` of each pixel [1/m].
void defocus(const BlurImage& image, const std::vector<float>& inverse_range, double aperture_px_m,
             double focus_m);
[[nodiscard]] float discAcross(float inverse_range, double aperture_px_m, double focus_m);  // [px]

// Forward scatter at small angles between ground and camera: the fraction 1 - exp(-k r) of each pixel is
// blurred (the forward component of Jaffe 1990, as a Gaussian).
void forwardScatter(const BlurImage& image, const std::vector<float>& inverse_range, double per_metre,
                    double spread_px);

// Direction and strength of a strobe for its glare in one camera.
struct LampInView {
  Eigen::Vector3d direction;  // unit, in the camera's frame
  double strength;            // over the image, towards the lamp
};
[[nodiscard]] std::vector<LampInView> lampsInView(const OpticsConfig& lamps, const SE3& T_body_cam);
// Glare of the strobes at a ray (x/z, y/z) of the camera.
[[nodiscard]] float glareAt(const std::vector<LampInView>& lamps, const Eigen::Vector2f& ray);

}  // namespace fathom::sim
