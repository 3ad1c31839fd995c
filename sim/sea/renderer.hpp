#pragma once

#include <cstdint>
#include <memory>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/sea/optics.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::sim {

// Light, water and exposure of one photograph.
struct PhotoConditions {
  std::vector<double> flashes;  // factor on each strobe's energy; empty: 1
  double turbidity = 1;         // factor on the scattering
  double exposure = 1;          // factor on the exposure time
  std::uint64_t snow_seed = 0;  // one for both images of a pair
  SE3 T_begin_end;              // the body's motion during the exposure
};

// Renders photographs of a terrain by a stereo rig with strobes.
// For a surface point with albedo A, at distance r from the camera, strobes s at distance d_s:
//   L = A / pi * sum_s V_s I_s(theta_s) cos(i_s) / d_s^2 * exp(-c (d_s + r)) + backscatter,
//   c = absorption + scattering
// (single scattering, after McGlamery 1980 and Jaffe 1990); V_s is a shadow ray. Daylight, marine snow,
// motion blur, defocus and forward scatter are added as configured. The sensor converts L, with vignetting
// and blur, to electrons with shot (Poisson) and read noise, and quantises them.
class Renderer {
 public:
  // `terrain` must outlive the renderer. Throws std::invalid_argument for optics out of range.
  Renderer(const SeaTerrain& terrain, const OpticsConfig& optics, const StereoRig& rig,
           const SE3& T_body_cam);
  ~Renderer();

  // Renders width * height samples of the side's camera into `out` (top row first, `bits` low bits, Bayer
  // mosaic or mono). `time_s` places moving objects. `noise_seed`: one for each image. Thread-safe;
  // spreads over the oneTBB threads of the caller's arena; the bytes depend on the arguments only.
  void render(const SE3& T_nav_body, double time_s, CameraSide side, std::uint64_t noise_seed,
              std::uint16_t* out, const PhotoConditions& conditions = {}) const;

  // Expected electrons of each pixel, before noise and quantisation (for tests of the noise and of
  // radiometry).
  void renderElectrons(const SE3& T_nav_body, double time_s, CameraSide side, float* out,
                       const PhotoConditions& conditions = {}) const;

  // Factor on the exposure for ground at this distance below the camera [m] that gives the level of
  // sensor.exposure_distance_m.
  [[nodiscard]] double exposureFactor(double distance_m) const;

  [[nodiscard]] int width(CameraSide side) const;
  [[nodiscard]] int height(CameraSide side) const;
  [[nodiscard]] PixelFormat format(CameraSide side) const;
  [[nodiscard]] int bits() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
