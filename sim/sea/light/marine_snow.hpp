#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/light/water_light.hpp"
#include "sim/sea/optics.hpp"

namespace fathom::sim {

// A particle in the water before the cameras.
struct Speck {
  Eigen::Vector3f position;  // in the left camera's frame [m]
  float diameter;            // [m]
};

// Those of one pair: both cameras see the same. Numbers fall with size as d^-slope (Junge's distribution; 4
// is usual in the sea, Bader 1970), from 0.5 mm up. Beyond kReach none is seen by itself.
[[nodiscard]] std::vector<Speck> marineSnow(const WaterConfig& water, const Camera& left, std::uint64_t seed);

// A speck as one camera sees it.
struct SeenSpeck {
  float x, y, range;  // [px], [m]
  float radius;       // of its disc [px], blurred where it is out of focus
  float cover;        // of the pixels within: less than 1 for what is smaller than a pixel
  Radiance radiance;
};

// `lamps`: as they are lit; the beams of its strobes are `beams`.
[[nodiscard]] std::vector<SeenSpeck> seenSpecks(const std::vector<Speck>& specks, const OpticsConfig& lamps,
                                                const Attenuation& attenuation,
                                                const std::vector<Beam>& beams, const Camera& camera,
                                                const SE3& T_body_cam, const SE3& T_body_left);

// Lays specks over an image, before surfaces farther than they are. `inverse_range`: of the surfaces [1/m];
// `channels` 1 (then `mono` weighs red, green, blue) or 3.
void layOver(const std::vector<SeenSpeck>& specks, const std::vector<float>& inverse_range, int width,
             int height, int channels, const Channels& mono, std::vector<float>& radiance);

}  // namespace fathom::sim
