#include "sim/sea/renderer.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <vector>

#include "sim/sea/ground/shapes.hpp"
#include "sim/sea/light/daylight.hpp"
#include "sim/sea/light/image_sensor.hpp"
#include "sim/sea/light/lens.hpp"
#include "sim/sea/light/marine_snow.hpp"
#include "sim/sea/light/ray_tracer.hpp"
#include "sim/sea/light/surface_detail.hpp"
#include "sim/sea/light/water_light.hpp"

namespace fathom::sim {
namespace {

// Moving objects farther than this from the camera are not rendered [m].
constexpr float kMovingRadius = 9.0F;

// Relative second difference of the inverse range that makes a pixel an edge (it is small on a plane).
constexpr float kEdgeBend = 0.004F;

// Offsets of the rays of an edge pixel from its centre [px]: patterns of 4 and of 8 on rotated grids.
constexpr float kSamples4[4][2] = {
    {-0.125F, -0.375F}, {0.375F, -0.125F}, {0.125F, 0.375F}, {-0.375F, 0.125F}};
constexpr float kSamples8[8][2] = {{0.0625F, -0.1875F},  {-0.0625F, 0.1875F}, {0.3125F, 0.0625F},
                                   {-0.1875F, -0.3125F}, {-0.3125F, 0.3125F}, {-0.4375F, -0.0625F},
                                   {0.1875F, 0.4375F},   {0.4375F, -0.4375F}};

// Strobes and water for one camera.
struct Light {
  Light(const OpticsConfig& optics, const Camera& camera, const SE3& T_body_cam)
      : attenuation(optics.water),
        beams(optics.strobes.begin(), optics.strobes.end()),
        backscatter(optics, attenuation, beams, camera, T_body_cam) {}
  WaterAttenuation attenuation;
  std::vector<Beam> beams;
  Backscatter backscatter;
};

struct CameraView {
  Camera camera;
  SE3 T_body_cam;
  PixelFormat format;
  CameraRays rays;
  Light light;                    // nominal, without perturbations of one image
  std::vector<float> vignetting;  // of each pixel
};

// Tiles at fixed places, so that the same rays are always in the same bundle: Embree's results may differ in
// the last bit between bundles.
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

// Radiance of an image, before the sensor's effects.
struct RadianceImage {
  RadianceImage(int w, int h, std::size_t count)
      : width(w),
        height(h),
        channels(count),
        radiance(at(0, h) * count),
        inverse_range(at(0, h)),
        lit(at(0, h)) {}
  [[nodiscard]] std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
  int width, height;
  std::size_t channels;              // 1 or 3, interleaved
  std::vector<float> radiance;       // of each channel
  std::vector<float> inverse_range;  // of the surface [1/m]
  std::vector<std::uint8_t> lit;     // bit s: strobe s lights the surface; 8 strobes at most
};

}  // namespace

struct Renderer::Impl {
  const SeaTerrain& terrain;
  OpticsConfig optics;
  MovingObjects moving;
  ImageSensor sensor;
  CameraView views[2];
  float electrons_per_radiance = 0;

  Impl(const SeaTerrain& t, const OpticsConfig& o, const StereoRig& rig, const SE3& T_body_cam)
      : terrain(t),
        optics(o),
        moving(t.config(), t.surface()),
        sensor(o.sensor),
        views{makeView(rig.left, T_body_cam, o.sensor.left_format),
              makeView(rig.right, T_body_cam * rig.T_right_left.inverse(), o.sensor.right_format)} {
    const float reference = whiteRadianceAt(o.sensor.exposure_distance_m);
    if (!(reference > 0))
      throw std::invalid_argument(
          "optics: no strobe lights the point at sensor.exposure_distance_m under the camera");
    electrons_per_radiance = static_cast<float>(o.sensor.exposure * o.sensor.full_well_electrons) / reference;
  }

  CameraView makeView(const Camera& camera, const SE3& T_body_cam, PixelFormat format) const {
    CameraView view{camera, T_body_cam, format, CameraRays(camera), Light(optics, camera, T_body_cam), {}};
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x)
        view.vignetting.push_back(static_cast<float>(std::pow(
            1.0 + view.rays.at(x, y).cast<double>().squaredNorm(), -0.5 * optics.sensor.vignetting_power)));
    return view;
  }

  // Response of a mono camera.
  [[nodiscard]] float mono(const Radiance& radiance) const {
    const Channels& q = optics.sensor.quantum_efficiency;
    return static_cast<float>((q[0] * radiance[0] + q[1] * radiance[1] + q[2] * radiance[2]) /
                              (q[0] + q[1] + q[2]));
  }

  // Mono radiance of white horizontal ground at this distance below the left camera.
  [[nodiscard]] float whiteRadianceAt(double distance_m) const {
    const CameraView& view = views[0];
    const Eigen::Vector3d axis = view.T_body_cam.rotation() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d point = view.T_body_cam.translation() + distance_m * axis;
    Radiance radiance{};
    for (std::size_t s = 0; s < optics.strobes.size(); ++s) {
      const StrobeIncidence shine(optics.strobes[s], view.light.beams[s], point);
      const double d = shine.distance, cosine = std::max(0.0, shine.from.dot(axis) / d);
      const Radiance transmission = view.light.attenuation(static_cast<float>(d + distance_m));
      for (std::size_t c = 0; c < 3; ++c)
        radiance[c] +=
            static_cast<float>(shine.intensity * cosine / (d * d) / std::numbers::pi) * transmission[c];
    }
    return mono(radiance);
  }

  // Strobes and water under the conditions of one photograph.
  [[nodiscard]] OpticsConfig opticsOf(const PhotoConditions& conditions) const {
    OpticsConfig out = optics;
    for (double& b : out.water.scattering_per_m) b *= conditions.turbidity;
    for (std::size_t s = 0; s < conditions.flashes.size(); ++s)
      out.strobes[s].intensity *= conditions.flashes[s];
    return out;
  }

  // Motion blur, forward scatter, defocus and the lens.
  void blurAll(const CameraView& view, const PhotoConditions& conditions,
               const std::vector<float>& inverse_range, const BlurImage& image) const;

  // Writes a pixel's radiance, as one or three channels.
  void put(const Radiance& value, std::size_t pixel, RadianceImage& image) const;
  // A ray through the centre of each pixel.
  void traceCentres(const Shot& shot, const CameraRays& view, RadianceImage& image) const;
  // The mean of several rays for pixels at the edge of an object or shadow.
  void traceEdges(const Shot& shot, const CameraRays& view, RadianceImage& image) const;
  void addGlare(const CameraView& view, const OpticsConfig& lamps, RadianceImage& image) const;
  // Expected electrons of each pixel of the mosaic.
  [[nodiscard]] std::vector<float> exposed(const CameraView& view, double exposure_factor,
                                           const RadianceImage& image) const;

  // Renders one image: expected electrons of each pixel.
  [[nodiscard]] std::vector<float> electrons(const SE3& T_nav_body, double time_s, const CameraView& view,
                                             const PhotoConditions& conditions) const;
};

void Renderer::Impl::put(const Radiance& value, std::size_t pixel, RadianceImage& image) const {
  if (image.channels == 1) {
    image.radiance[pixel] = mono(value);
  } else {
    std::copy_n(value.begin(), 3, &image.radiance[3 * pixel]);
  }
}

void Renderer::Impl::traceCentres(const Shot& shot, const CameraRays& view, RadianceImage& image) const {
  forTiles(image.width, image.height, [&](int y, int x_begin, int x_end) {
    RayBundle rays;
    for (int x = x_begin; x < x_end; x += RayBundle::kSize) {
      rays.count = std::min(RayBundle::kSize, x_end - x);
      for (int i = 0; i < rays.count; ++i) {
        rays.x_px[i] = static_cast<float>(x + i), rays.y_px[i] = static_cast<float>(y);
        rays.normalised[i] = view.at(x + i, y);
        rays.origin[i] = view.origin(x + i, y);
      }
      trace(shot, rays);
      for (int i = 0; i < rays.count; ++i) {
        const std::size_t pixel = image.at(x + i, y);
        put(rays.radiance[i], pixel, image);
        image.inverse_range[pixel] = rays.inverse_range[i];
        image.lit[pixel] = static_cast<std::uint8_t>(rays.lit[i]);
      }
    }
  });
}

void Renderer::Impl::traceEdges(const Shot& shot, const CameraRays& view, RadianceImage& image) const {
  if (optics.edge_samples <= 1) return;
  const auto* samples = optics.edge_samples == 4 ? kSamples4 : kSamples8;
  const auto isEdge = [&image](std::size_t one, std::size_t middle, std::size_t other) {
    const std::vector<float>& inverse = image.inverse_range;
    return std::abs(inverse[one] - 2 * inverse[middle] + inverse[other]) > kEdgeBend * inverse[middle] ||
           image.lit[one] != image.lit[middle] || image.lit[other] != image.lit[middle];
  };
  forTiles(image.width, image.height, [&](int y, int x_begin, int x_end) {
    const int above = std::max(0, y - 1), below = std::min(image.height - 1, y + 1);
    RayBundle rays;
    for (int x = x_begin; x < x_end; ++x) {
      const std::size_t pixel = image.at(x, y);
      if (!isEdge(image.at(std::max(0, x - 1), y), pixel, image.at(std::min(image.width - 1, x + 1), y)) &&
          !isEdge(image.at(x, above), pixel, image.at(x, below)))
        continue;
      rays.count = optics.edge_samples;
      for (int i = 0; i < rays.count; ++i) {
        rays.x_px[i] = static_cast<float>(x) + samples[i][0];
        rays.y_px[i] = static_cast<float>(y) + samples[i][1];
        rays.normalised[i] = view.near(x, y, samples[i][0], samples[i][1]);
        rays.origin[i] = view.origin(x, y);
      }
      trace(shot, rays);
      Radiance mean{};
      for (int i = 0; i < rays.count; ++i)
        for (std::size_t c = 0; c < 3; ++c) mean[c] += rays.radiance[i][c] / static_cast<float>(rays.count);
      put(mean, pixel, image);
    }
  });
}

void Renderer::Impl::addGlare(const CameraView& view, const OpticsConfig& lamps, RadianceImage& image) const {
  if (optics.sensor.glare <= 0) return;
  const std::vector<LampInView> in_view = lampsInView(lamps, view.T_body_cam);
  forTiles(image.width, image.height, [&](int y, int x_begin, int x_end) {
    for (int x = x_begin; x < x_end; ++x) {
      const float veil = glareAt(in_view, view.rays.at(x, y));
      for (std::size_t c = 0; c < image.channels; ++c)
        image.radiance[image.channels * image.at(x, y) + c] += veil;
    }
  });
}

std::vector<float> Renderer::Impl::exposed(const CameraView& view, double exposure_factor,
                                           const RadianceImage& image) const {
  const Channels& q = optics.sensor.quantum_efficiency;
  const double best = std::max({q[0], q[1], q[2]});
  const float exposure = electrons_per_radiance * static_cast<float>(exposure_factor);
  std::vector<float> out(image.inverse_range.size());
  forTiles(image.width, image.height, [&](int y, int x_begin, int x_end) {
    for (int x = x_begin; x < x_end; ++x) {
      const std::size_t pixel = image.at(x, y);
      float value = 0;
      if (image.channels == 1) {
        value = image.radiance[pixel];
      } else {
        const auto c = static_cast<std::size_t>(bayerChannel(x, y));
        value = static_cast<float>(q[c] / best) * image.radiance[3 * pixel + c];
      }
      out[pixel] = exposure * view.vignetting[pixel] * value;
    }
  });
  return out;
}

std::vector<float> Renderer::Impl::electrons(const SE3& T_nav_body, double time_s, const CameraView& view,
                                             const PhotoConditions& conditions) const {
  const OpticsConfig lamps = opticsOf(conditions);
  const bool undisturbed =
      conditions.turbidity == 1 &&
      std::all_of(conditions.flashes.begin(), conditions.flashes.end(), [](double f) { return f == 1; });
  std::optional<Light> perturbed;
  if (!undisturbed) perturbed.emplace(lamps, view.camera, view.T_body_cam);
  const Light& light = perturbed ? *perturbed : view.light;
  const Daylight daylight(optics.daylight, optics.water, conditions.turbidity, time_s);
  const SurfaceScene& bed = terrain.surface();
  const SE3 T_local_body(T_nav_body.rotation(), T_nav_body.translation() - bed.origin());
  const SE3 T_local_cam = T_local_body * view.T_body_cam;
  const Eigen::Vector3f eye = T_local_cam.translation().cast<float>();
  const std::unique_ptr<SurfaceScene> objects = moving.near(eye, kMovingRadius, time_s);
  Shot shot{bed,
            objects.get(),
            terrain.detail(),
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
  RadianceImage image(view.camera.width, view.camera.height, view.format == PixelFormat::kMono ? 1 : 3);
  traceCentres(shot, view.rays, image);
  traceEdges(shot, view.rays, image);
  const int channels = static_cast<int>(image.channels);
  drawSpecks(visibleSpecks(marineSnow(optics.water, views[0].camera, conditions.snow_seed), lamps,
                           light.attenuation, light.beams, view.camera, view.T_body_cam, views[0].T_body_cam),
             image.inverse_range, image.width, image.height, channels, optics.sensor.quantum_efficiency,
             image.radiance);
  addGlare(view, lamps, image);
  blurAll(view, conditions, image.inverse_range, {image.radiance, image.width, image.height, channels});
  return exposed(view, conditions.exposure, image);
}

void Renderer::Impl::blurAll(const CameraView& view, const PhotoConditions& conditions,
                             const std::vector<float>& inverse_range, const BlurImage& image) const {
  const double focal = 0.5 * (view.camera.fx + view.camera.fy);
  const SE3 T_end_begin = view.T_body_cam.inverse() * conditions.T_begin_end.inverse() * view.T_body_cam;
  const bool moves = T_end_begin.log().norm() > 0;
  if (moves) {
    motionBlur(image, [&](int x, int y) -> Eigen::Vector2f {
      const auto pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
      const Eigen::Vector2f ray = view.rays.at(x, y);
      const double range = 1 / std::max(1e-3, static_cast<double>(inverse_range[pixel]));
      const Eigen::Vector3d end = T_end_begin * (range * Eigen::Vector3d(ray.x(), ray.y(), 1).normalized());
      return static_cast<float>(focal) * ((end.head<2>() / end.z()).cast<float>() - ray);
    });
  }
  forwardScatter(image, inverse_range, optics.water.forward_per_m,
                 focal * std::tan(optics.water.forward_rad));
  defocus(image, inverse_range, 0.001 * optics.sensor.aperture_mm * focal, optics.sensor.focus_m);
  blur(image, optics.sensor.blur_sigma_px);
}

Renderer::Renderer(const SeaTerrain& terrain, const OpticsConfig& optics, const StereoRig& rig,
                   const SE3& T_body_cam) {
  validate(optics);
  impl_ = std::make_unique<Impl>(terrain, optics, rig, T_body_cam);
}

Renderer::~Renderer() = default;

void Renderer::render(const SE3& T_nav_body, double time_s, CameraSide side, std::uint64_t noise_seed,
                      std::uint16_t* out, const PhotoConditions& conditions) const {
  const CameraView& view = impl_->views[static_cast<std::size_t>(side)];
  std::vector<float> electrons = impl_->electrons(T_nav_body, time_s, view, conditions);
  if (side == CameraSide::kRight)
    for (float& e : electrons) e *= static_cast<float>(impl_->optics.sensor.right_gain);
  impl_->sensor.expose(electrons.data(), view.camera.width, view.camera.height, noise_seed, out);
}

void Renderer::renderElectrons(const SE3& T_nav_body, double time_s, CameraSide side, float* out,
                               const PhotoConditions& conditions) const {
  const std::vector<float> electrons =
      impl_->electrons(T_nav_body, time_s, impl_->views[static_cast<std::size_t>(side)], conditions);
  std::copy(electrons.begin(), electrons.end(), out);
}

double Renderer::exposureFactor(double distance_m) const {
  const double level = static_cast<double>(impl_->whiteRadianceAt(distance_m));
  return static_cast<double>(impl_->whiteRadianceAt(impl_->optics.sensor.exposure_distance_m)) /
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
