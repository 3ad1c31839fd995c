#pragma once

#include <cstdint>
#include <memory>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "sim/sea/optics.hpp"
#include "sim/sea/terrain.hpp"

namespace fathom::sim {

// What differs from photograph to photograph beside place and time.
struct Moment {
  std::vector<double> flashes;  // energy of each strobe over its usual; empty: 1
  double turbidity = 1;         // scattering over its usual
  double exposure = 1;          // time over its usual
  std::uint64_t snow_seed = 0;  // one for both images of a pair
  SE3 T_begin_end;              // the body's motion while the image gathers light
};

// Photographs of a terrain by a stereo rig and its strobes.
// For a surface point with albedo A, at distance r from the camera, strobes s at distance d_s:
//   L = A / pi * sum_s V_s I_s(theta_s) cos(i_s) / d_s^2 * exp(-c (d_s + r)) + backscatter,  c = absorption +
//   scattering
// (single scattering, after McGlamery 1980 and Jaffe 1990); V_s is a shadow ray. Daylight, marine snow,
// motion, defocus and forward scatter change it where the configuration has them. The sensor turns L,
// vignetting and blur into electrons with shot (Poisson) and read noise, then into whole numbers.
class Renderer {
 public:
  // `terrain` must outlive the renderer. Throws std::invalid_argument for optics out of range.
  Renderer(const Terrain& terrain, const OpticsConfig& optics, const StereoRig& rig, const SE3& T_body_cam);
  ~Renderer();

  // Renders width * height samples of the side's camera into `out` (top row first, `bits` low bits, Bayer
  // mosaic or mono). `time_s`: where moving things are. `noise_seed`: one for each image. Thread-safe;
  // spreads over the oneTBB threads of the caller's arena; the bytes depend on the arguments only.
  void render(const SE3& T_nav_body, double time_s, CameraSide side, std::uint64_t noise_seed,
              std::uint16_t* out, const Moment& moment = {}) const;

  // Expected electrons of each pixel, before noise and quantisation (for tests of the noise and of
  // radiometry).
  void renderElectrons(const SE3& T_nav_body, double time_s, CameraSide side, float* out,
                       const Moment& moment = {}) const;

  // By which the exposure must grow over ground this far below the camera [m] for the level that it has at
  // sensor.exposure_distance_m.
  [[nodiscard]] double exposureAt(double distance_m) const;

  [[nodiscard]] int width(CameraSide side) const;
  [[nodiscard]] int height(CameraSide side) const;
  [[nodiscard]] PixelFormat format(CameraSide side) const;
  [[nodiscard]] int bits() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::sim
