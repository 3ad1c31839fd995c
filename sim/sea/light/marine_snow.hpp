#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/light/water_light.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// A particle in the water in front of the cameras.
struct Speck {
  Eigen::Vector3f position;  // in the left camera's frame [m]
  float diameter;            // [m]
};

// Particles of one pair, common to both cameras. Their number falls with size as d^-slope (Junge's
// distribution; 4 is usual in the sea, Bader 1970) from 0.5 mm; they are within kReach of the cameras.
[[nodiscard]] std::vector<Speck> marineSnow(const WaterConfig& water, const Camera& left, std::uint64_t seed);

// A particle in one camera's image.
struct VisibleSpeck {
  float x, y, range;  // [px], [m]
  float radius;       // of its disc [px], blurred where it is out of focus
  float cover;        // opacity of the disc; less than 1 for particles smaller than a pixel
  Radiance radiance;
};

// `lamps` with the strobes' intensities in this photograph; `beams` are their beams.
[[nodiscard]] std::vector<VisibleSpeck> visibleSpecks(const std::vector<Speck>& specks,
                                                      const OpticsConfig& lamps,
                                                      const WaterAttenuation& attenuation,
                                                      const std::vector<Beam>& beams, const Camera& camera,
                                                      const SE3& T_body_cam, const SE3& T_body_left);

// Draws particles over an image, in front of surfaces farther away. `inverse_range`: of the surfaces [1/m];
// `channels` 1 (then `mono` weighs red, green, blue) or 3.
void drawSpecks(const std::vector<VisibleSpeck>& specks, const std::vector<float>& inverse_range, int width,
                int height, int channels, const Channels& mono, std::vector<float>& radiance);

}  // namespace fathom::sim
