#include "sim/sea/renderer.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <vector>

#include "sim/sea/ground/moving_things.hpp"
#include "sim/sea/light/camera_rays.hpp"
#include "sim/sea/light/daylight.hpp"
#include "sim/sea/light/image_sensor.hpp"
#include "sim/sea/light/lens_blur.hpp"
#include "sim/sea/light/marine_snow.hpp"
#include "sim/sea/light/ray_tracer.hpp"
#include "sim/sea/light/surface_detail.hpp"
#include "sim/sea/light/water_light.hpp"

namespace fathom::sim {
namespace {

// Moving things farther than this from the camera are left out of its picture [m].
constexpr float kMovingRadius = 9.0F;

// An edge: the inverse range bends by more than this part of itself from pixel to pixel (on a plane it does
// not bend).
constexpr float kEdgeBend = 0.004F;

// Where the rays of an edge pixel go, in pixels off its centre: rotated grids of 4 and of 8.
constexpr float kSamples4[4][2] = {
    {-0.125F, -0.375F}, {0.375F, -0.125F}, {0.125F, 0.375F}, {-0.375F, 0.125F}};
constexpr float kSamples8[8][2] = {{0.0625F, -0.1875F},  {-0.0625F, 0.1875F}, {0.3125F, 0.0625F},
                                   {-0.1875F, -0.3125F}, {-0.3125F, 0.3125F}, {-0.4375F, -0.0625F},
                                   {0.1875F, 0.4375F},   {0.4375F, -0.4375F}};

// Lamps and water as one camera has them.
struct Light {
  Light(const OpticsConfig& optics, const Camera& camera, const SE3& T_body_cam)
      : attenuation(optics.water),
        beams(optics.strobes.begin(), optics.strobes.end()),
        backscatter(optics, attenuation, beams, camera, T_body_cam) {}
  Attenuation attenuation;
  std::vector<Beam> beams;
  Backscatter backscatter;
};

struct View {
  Camera camera;
  SE3 T_body_cam;
  PixelFormat format;
  CameraRays rays;
  Light light;                    // as usual
  std::vector<float> vignetting;  // of each pixel
};

// Tiles of fixed places, so that the same rays always travel in the same bundle: Embree's results may differ
// in the last bit from bundle to bundle.
constexpr int kTileRows = 16, kTileColumns = 64;

// Calls work(y, x_begin, x_end) for each row of each tile, tiles in parallel.
template <typename Work>
void forTiles(int width, int height, const Work& work) {
  const int across = (width + kTileColumns - 1) / kTileColumns, down = (height + kTileRows - 1) / kTileRows;
  oneapi::tbb::parallel_for(0, across * down, [&](int tile) {
    const int x_begin = tile % across * kTileColumns, y_begin = tile / across * kTileRows;
    for (int y = y_begin; y < std::min(height, y_begin + kTileRows); ++y)
      work(y, x_begin, std::min(width, x_begin + kTileColumns));
  });
}

// A strobe as a camera would see it, for its glare.
struct LampSeen {
  Eigen::Vector3d direction;  // unit, in the camera's frame
  double strength;            // over the image, towards the lamp
};

std::vector<LampSeen> lampsSeen(const View& view, const OpticsConfig& lamps) {
  std::vector<LampSeen> out;
  for (const StrobeConfig& strobe : lamps.strobes) {
    const Eigen::Vector3d to = view.T_body_cam.inverse() * strobe.position_body;
    out.push_back(
        {to.normalized(), lamps.sensor.glare * strobe.intensity / to.squaredNorm() / std::numbers::pi});
  }
  return out;
}

float glareAt(const std::vector<LampSeen>& lamps, const Eigen::Vector2f& ray) {
  constexpr double kWide = 0.3;  // angle off the lamp at which it has fallen to a quarter [rad]
  const Eigen::Vector3d direction = ray.homogeneous().cast<double>().normalized();
  double sum = 0;
  for (const LampSeen& lamp : lamps) {
    const double angle = std::acos(std::clamp(direction.dot(lamp.direction), -1.0, 1.0));
    const double fall = kWide / (kWide + angle);
    sum += lamp.strength * fall * fall;
  }
  return static_cast<float>(sum);
}

}  // namespace

struct Renderer::Impl {
  const Terrain& terrain;
  OpticsConfig optics;
  SurfaceDetail detail;
  MovingThings moving;
  ImageSensor sensor;
  View views[2];
  float electrons_per_radiance = 0;

  Impl(const Terrain& t, const OpticsConfig& o, const StereoRig& rig, const SE3& T_body_cam)
      : terrain(t),
        optics(o),
        detail(SurfaceDetail::of(t.config())),
        moving(t.config(), t.surface()),
        sensor(o.sensor),
        views{makeView(rig.left, T_body_cam, o.sensor.left_format),
              makeView(rig.right, T_body_cam * rig.T_right_left.inverse(), o.sensor.right_format)} {
    const float reference = levelAt(o.sensor.exposure_distance_m);
    if (!(reference > 0))
      throw std::invalid_argument(
          "optics: no strobe lights the point at sensor.exposure_distance_m under the camera");
    electrons_per_radiance = static_cast<float>(o.sensor.exposure * o.sensor.full_well_electrons) / reference;
  }

  View makeView(const Camera& camera, const SE3& T_body_cam, PixelFormat format) const {
    View view{camera, T_body_cam, format, CameraRays(camera), Light(optics, camera, T_body_cam), {}};
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x)
        view.vignetting.push_back(static_cast<float>(std::pow(
            1.0 + view.rays.at(x, y).cast<double>().squaredNorm(), -0.5 * optics.sensor.vignetting_power)));
    return view;
  }

  // What a mono camera makes of the channels.
  [[nodiscard]] float mono(const Radiance& radiance) const {
    const Channels& q = optics.sensor.quantum_efficiency;
    return static_cast<float>((q[0] * radiance[0] + q[1] * radiance[1] + q[2] * radiance[2]) /
                              (q[0] + q[1] + q[2]));
  }

  // Radiance of white level ground this far below the left camera, as a mono camera sees it.
  [[nodiscard]] float levelAt(double distance_m) const {
    const View& view = views[0];
    const Eigen::Vector3d axis = view.T_body_cam.rotation() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d point = view.T_body_cam.translation() + distance_m * axis;
    Radiance radiance{};
    for (std::size_t s = 0; s < optics.strobes.size(); ++s) {
      const Shine shine(optics.strobes[s], view.light.beams[s], point);
      const double d = shine.distance, cosine = std::max(0.0, shine.from.dot(axis) / d);
      const Radiance left = view.light.attenuation(static_cast<float>(d + distance_m));
      for (std::size_t c = 0; c < 3; ++c)
        radiance[c] += static_cast<float>(shine.intensity * cosine / (d * d) / std::numbers::pi) * left[c];
    }
    return mono(radiance);
  }

  // Lamps and water of a moment that are not as usual.
  [[nodiscard]] OpticsConfig opticsOf(const Moment& moment) const {
    OpticsConfig out = optics;
    for (double& b : out.water.scattering_per_m) b *= moment.turbidity;
    for (std::size_t s = 0; s < moment.flashes.size(); ++s) out.strobes[s].intensity *= moment.flashes[s];
    return out;
  }

  // Everything between a sharp image and the sensor.
  void blurAll(const View& view, const Moment& moment, const std::vector<float>& inverse_range,
               const BlurImage& image) const;

  void electrons(const SE3& T_nav_body, double time_s, const View& view, const Moment& moment,
                 std::vector<float>& out) const;
};

void Renderer::Impl::electrons(const SE3& T_nav_body, double time_s, const View& view, const Moment& moment,
                               std::vector<float>& out) const {
  const OpticsConfig lamps = opticsOf(moment);
  const bool usual = moment.turbidity == 1 && std::all_of(moment.flashes.begin(), moment.flashes.end(),
                                                          [](double f) { return f == 1; });
  std::optional<Light> own;
  if (!usual) own.emplace(lamps, view.camera, view.T_body_cam);
  const Light& light = own ? *own : view.light;
  const Daylight daylight(optics.daylight, optics.water, moment.turbidity, time_s);
  const SurfaceScene& bed = terrain.surface();
  const SE3 T_local_body(T_nav_body.rotation(), T_nav_body.translation() - bed.origin());
  const SE3 T_local_cam = T_local_body * view.T_body_cam;
  const Eigen::Vector3f eye = T_local_cam.translation().cast<float>();
  const std::unique_ptr<SurfaceScene> things = moving.near(eye, kMovingRadius, time_s);
  Shot shot{bed,
            things.get(),
            detail,
            light.attenuation,
            light.backscatter,
            daylight,
            light.beams,
            {},
            {},
            eye,
            static_cast<float>(bed.origin().z()),
            T_local_cam.matrix3().cast<float>(),
            static_cast<float>(0.5 * (view.camera.fx + view.camera.fy))};
  for (const StrobeConfig& strobe : optics.strobes) {
    shot.strobe_positions.push_back((T_local_body * strobe.position_body).cast<float>());
    shot.strobe_directions.push_back(
        (T_local_body.rotation() * strobe.direction_body.normalized()).cast<float>());
  }

  const int width = view.camera.width, height = view.camera.height;
  const std::size_t channels = view.format == PixelFormat::kMono ? 1 : 3;
  const auto at = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  };
  const std::size_t pixels = at(0, height);
  std::vector<float> radiance(pixels * channels), inverse_range(pixels);
  std::vector<std::uint8_t> lit(pixels);
  const auto put = [&](std::size_t pixel, const Radiance& value) {
    if (channels == 1) {
      radiance[pixel] = mono(value);
    } else {
      std::copy_n(value.begin(), 3, &radiance[3 * pixel]);
    }
  };

  // A ray through the centre of each pixel.
  forTiles(width, height, [&](int y, int x_begin, int x_end) {
    RayBundle rays;
    for (int x = x_begin; x < x_end; x += RayBundle::kSize) {
      rays.count = std::min(RayBundle::kSize, x_end - x);
      for (int i = 0; i < rays.count; ++i) {
        rays.x_px[i] = static_cast<float>(x + i), rays.y_px[i] = static_cast<float>(y);
        rays.normalised[i] = view.rays.at(x + i, y);
        rays.origin[i] = view.rays.origin(x + i, y);
      }
      trace(shot, rays);
      for (int i = 0; i < rays.count; ++i) {
        const std::size_t pixel = at(x + i, y);
        put(pixel, rays.radiance[i]);
        inverse_range[pixel] = rays.inverse_range[i];
        lit[pixel] = static_cast<std::uint8_t>(rays.lit[i]);
      }
    }
  });

  // More rays where a thing or a shadow ends.
  if (optics.edge_samples > 1) {
    const auto* samples = optics.edge_samples == 4 ? kSamples4 : kSamples8;
    const auto bends = [&](int x0, int y0, int x, int y, int x1, int y1) {
      const float middle = inverse_range[at(x, y)];
      return std::abs(inverse_range[at(x0, y0)] - 2 * middle + inverse_range[at(x1, y1)]) >
                 kEdgeBend * middle ||
             lit[at(x0, y0)] != lit[at(x, y)] || lit[at(x1, y1)] != lit[at(x, y)];
    };
    forTiles(width, height, [&](int y, int x_begin, int x_end) {
      const int above = std::max(0, y - 1), below = std::min(height - 1, y + 1);
      RayBundle rays;
      for (int x = x_begin; x < x_end; ++x) {
        const int before = std::max(0, x - 1), after = std::min(width - 1, x + 1);
        if (!bends(before, y, x, y, after, y) && !bends(x, above, x, y, x, below)) continue;
        rays.count = optics.edge_samples;
        for (int i = 0; i < rays.count; ++i) {
          rays.x_px[i] = static_cast<float>(x) + samples[i][0],
          rays.y_px[i] = static_cast<float>(y) + samples[i][1];
          rays.normalised[i] = view.rays.near(x, y, samples[i][0], samples[i][1]);
          rays.origin[i] = view.rays.origin(x, y);
        }
        trace(shot, rays);
        Radiance mean{};
        for (int i = 0; i < rays.count; ++i)
          for (std::size_t c = 0; c < 3; ++c) mean[c] += rays.radiance[i][c] / static_cast<float>(rays.count);
        put(at(x, y), mean);
      }
    });
  }

  layOver(seenSpecks(marineSnow(optics.water, views[0].camera, moment.snow_seed), lamps, light.attenuation,
                     light.beams, view.camera, view.T_body_cam, views[0].T_body_cam),
          inverse_range, width, height, static_cast<int>(channels), optics.sensor.quantum_efficiency,
          radiance);
  if (optics.sensor.glare > 0) {
    const std::vector<LampSeen> seen = lampsSeen(view, lamps);
    forTiles(width, height, [&](int y, int x_begin, int x_end) {
      for (int x = x_begin; x < x_end; ++x) {
        const float veil = glareAt(seen, view.rays.at(x, y));
        for (std::size_t c = 0; c < channels; ++c) radiance[channels * at(x, y) + c] += veil;
      }
    });
  }
  blurAll(view, moment, inverse_range, {radiance, width, height, static_cast<int>(channels)});
  const Channels& q = optics.sensor.quantum_efficiency;
  const double best = std::max({q[0], q[1], q[2]});
  const float exposure = electrons_per_radiance * static_cast<float>(moment.exposure);
  out.resize(pixels);
  forTiles(width, height, [&](int y, int x_begin, int x_end) {
    for (int x = x_begin; x < x_end; ++x) {
      float value = 0;
      if (channels == 1) {
        value = radiance[at(x, y)];
      } else {
        const auto c = static_cast<std::size_t>(bayerChannel(x, y));
        value = static_cast<float>(q[c] / best) * radiance[3 * at(x, y) + c];
      }
      out[at(x, y)] = exposure * view.vignetting[at(x, y)] * value;
    }
  });
}

void Renderer::Impl::blurAll(const View& view, const Moment& moment, const std::vector<float>& inverse_range,
                             const BlurImage& image) const {
  const double focal = 0.5 * (view.camera.fx + view.camera.fy);
  const SE3 T_end_begin = view.T_body_cam.inverse() * moment.T_begin_end.inverse() * view.T_body_cam;
  const bool moves = T_end_begin.log().norm() > 0;
  if (moves) {
    motionBlur(image, [&](int x, int y) -> Eigen::Vector2f {
      const auto pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
      const Eigen::Vector2f ray = view.rays.at(x, y);
      const double z = 1 / std::max(1e-3, static_cast<double>(inverse_range[pixel]));
      const Eigen::Vector3d end = T_end_begin * (z * Eigen::Vector3d(ray.x(), ray.y(), 1));
      return static_cast<float>(focal) * ((end.head<2>() / end.z()).cast<float>() - ray);
    });
  }
  forwardScatter(image, inverse_range, optics.water.forward_per_m,
                 focal * std::tan(optics.water.forward_rad));
  defocus(image, inverse_range, 0.001 * optics.sensor.aperture_mm * focal, optics.sensor.focus_m);
  blur(image, optics.sensor.blur_sigma_px);
}

Renderer::Renderer(const Terrain& terrain, const OpticsConfig& optics, const StereoRig& rig,
                   const SE3& T_body_cam) {
  validate(optics);
  impl_ = std::make_unique<Impl>(terrain, optics, rig, T_body_cam);
}

Renderer::~Renderer() = default;

void Renderer::render(const SE3& T_nav_body, double time_s, CameraSide side, std::uint64_t noise_seed,
                      std::uint16_t* out, const Moment& moment) const {
  const View& view = impl_->views[static_cast<std::size_t>(side)];
  std::vector<float> electrons;
  impl_->electrons(T_nav_body, time_s, view, moment, electrons);
  if (side == CameraSide::kRight)
    for (float& e : electrons) e *= static_cast<float>(impl_->optics.sensor.right_gain);
  impl_->sensor.expose(electrons.data(), view.camera.width, view.camera.height, noise_seed, out);
}

void Renderer::renderElectrons(const SE3& T_nav_body, double time_s, CameraSide side, float* out,
                               const Moment& moment) const {
  std::vector<float> electrons;
  impl_->electrons(T_nav_body, time_s, impl_->views[static_cast<std::size_t>(side)], moment, electrons);
  std::copy(electrons.begin(), electrons.end(), out);
}

double Renderer::exposureAt(double distance_m) const {
  const double level = static_cast<double>(impl_->levelAt(distance_m));
  return static_cast<double>(impl_->levelAt(impl_->optics.sensor.exposure_distance_m)) /
         std::max(level, 1e-9);
}

int Renderer::width(CameraSide side) const {
  return impl_->views[static_cast<std::size_t>(side)].camera.width;
}
int Renderer::height(CameraSide side) const {
  return impl_->views[static_cast<std::size_t>(side)].camera.height;
}
PixelFormat Renderer::format(CameraSide side) const {
  return impl_->views[static_cast<std::size_t>(side)].format;
}
int Renderer::bits() const {
  return impl_->optics.sensor.bits;
}

}  // namespace fathom::sim
