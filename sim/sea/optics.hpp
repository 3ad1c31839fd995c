#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "realtime/base/units.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::sim {

// Red, green, blue; a mono camera sees their mean, weighted by `quantum_efficiency`.
using Channels = std::array<double, 3>;

struct StrobeConfig {
  Eigen::Vector3d position_body{0, 0, 0};   // [m]
  Eigen::Vector3d direction_body{0, 0, 1};  // axis of the beam, any length
  double intensity = 1.0;                   // on the axis, relative to the other strobe
  double half_angle_rad = 0.70;             // off the axis, at which the intensity is one half
  double dies_at_s = 1e6;                   // dark from then on [s], since the mission's start
};

// Silt raised by thrusters.
struct Silt {
  double at_s = 0;        // since the mission's start
  double times = 5;       // factor on the scattering
  double settles_s = 30;  // time constant
};

// Sea water (typical of clear coastal water, Jerlov II) along every path of light.
struct WaterConfig {
  Channels absorption_per_m{0.34, 0.065, 0.045};
  Channels scattering_per_m{0.06, 0.07, 0.08};
  double backscatter_fraction = 0.02;  // of the scattered light that turns back
  double patches = 0;                  // factor on the scattering's variation with the patches of sediment
  double forward_per_m = 0;  // of the light that small-angle scattering spreads on its path to the camera
  double forward_rad = degreesToRadians(0.5);  // standard deviation of the spread
  double snow_per_m3 = 0;                      // particles above 0.5 mm
  double snow_slope = 4;                       // their number falls with size as d^-slope
  double snow_largest_mm = 8;
  double snow_albedo = 0.4;
  std::vector<Silt> silt{};
};

// Sun and sky. An irradiance of 1 is that of a strobe of intensity 1, 1 m away, without water.
struct DaylightConfig {
  double irradiance = 0;                            // just below the surface; 0: night, or deep
  double sun_elevation_rad = degreesToRadians(50);  // in air
  double sun_azimuth_rad = degreesToRadians(30);    // clockwise from north
  double sun_share = 0.6;                           // of the irradiance; the rest comes from the sky
  double caustics = 0;            // standard deviation of the sun's part on the seafloor, relative
  double caustic_size_m = 0.4;    // of the cells between bright lines
  double caustic_period_s = 1.5;  // in which they change
};

struct ImageSensorConfig {
  PixelFormat left_format = PixelFormat::kBayerRggb;  // kMono or kBayerRggb
  PixelFormat right_format = PixelFormat::kMono;
  int bits = 12;  // 8 or 12
  Channels quantum_efficiency{0.75, 1.0, 0.85};
  double full_well_electrons = 12000;
  double read_noise_electrons = 14;  // standard deviation
  double black_level = 0.005;        // of full scale
  double vignetting_power = 3.0;     // relative illumination is cos^power of the angle off the axis
  double blur_sigma_px = 0.55;       // lens and pixel aperture; 0: none
  // Exposure: a level, white (albedo 1), mono seafloor at the reference distance under the camera gives this
  // fraction of full scale in the image's centre.
  double exposure = 1.3;
  double exposure_distance_m = 2.0;
  double right_gain = 1.0;   // of the right camera over the left one's
  double auto_exposure = 0;  // 0: fixed; 1: the time follows the altitude so that the level stays
  double open_s = 0;         // exposure time that causes motion blur; 0: none
  double aperture_mm = 0;    // of the lens; 0: everything is in focus
  double focus_m = 2.0;
  double glare = 0;  // fraction of a strobe's light at 1 m that lens and port scatter over the image
};

struct OpticsConfig {
  std::vector<StrobeConfig> strobes{{{0.75, 0.0, 0.0}, {-0.18, 0.0, 1.0}, 1.0, 0.70},
                                    {{-0.75, 0.0, 0.0}, {0.18, 0.0, 1.0}, 1.0, 0.70}};
  WaterConfig water;
  DaylightConfig daylight;
  ImageSensorConfig sensor;
  double flash_sigma = 0;          // of the strobes' energy from pair to pair, relative
  double dark_probability = 0;     // that all strobes stay dark in a pair
  double misfire_probability = 0;  // that one strobe stays dark, each independently
  double vibration_rad = 0;        // amplitude of the hull's roll and pitch, which no sensor measures
  double vibration_hz = 25;
  int edge_samples = 4;  // rays of a pixel on an edge of an object or shadow; 1, 4 or 8
};

// Throws std::invalid_argument that names the member and its range.
void validate(const OpticsConfig& config);

}  // namespace fathom::sim
