#include "sim/picture/mesh_view.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "sim/sea/ground/random.hpp"
#include "sim/sea/ground/surface_scene.hpp"

namespace fathom::sim {
namespace {

constexpr float kElevation = 0.73F;  // [rad], of the oblique view over the horizon
constexpr float kBorder = 0.04F;     // of the picture
constexpr int kSide = 2;             // rays a pixel: kSide x kSide
constexpr int kSkyRays = 3;          // for each of these
constexpr float kSkyReach = 0.06F;   // how far a corner hides the sky, of the mesh's size
constexpr float kSunShare = 0.62F;   // of the light on a level surface
const Eigen::Vector3f kSun =
    Eigen::Vector3f(0.45F, -0.60F, -0.85F).normalized();  // towards it: north-west, up
constexpr Rgb kBackground{238, 241, 244};

std::array<Rgb, 256> makeRamp() {
  cv::Mat values(256, 1, CV_8UC1), colours;
  for (int i = 0; i < 256; ++i) values.at<std::uint8_t>(i) = static_cast<std::uint8_t>(255 - i);
  cv::applyColorMap(values, colours, cv::COLORMAP_VIRIDIS);
  std::array<Rgb, 256> ramp;
  for (int i = 0; i < 256; ++i) {
    const auto& bgr = colours.at<cv::Vec3b>(i);
    ramp[static_cast<std::size_t>(i)] = {bgr[2], bgr[1], bgr[0]};
  }
  return ramp;
}

// Brings the brighter parts of a mesh's colours to a light grey: a map of dark seafloor is still to be seen.
float brightening(const Mesh& mesh) {
  if (mesh.colours.empty()) return 1.0F;
  std::array<std::size_t, 256> histogram{};
  for (const Rgb& c : mesh.colours) ++histogram[std::max({c[0], c[1], c[2]})];
  std::size_t above = 0;
  int level = 255;
  while (level > 1 && (above += histogram[static_cast<std::size_t>(level)]) < mesh.colours.size() / 20)
    --level;
  constexpr float kLightGrey = 0.62F, kMost = 8.0F;
  return std::clamp(kLightGrey / linearFromSrgb(static_cast<std::uint8_t>(level)), 1.0F, kMost);
}

// A direction over the surface, more often near its normal: cosine-weighted.
Eigen::Vector3f skyDirection(const Eigen::Vector3f& normal, std::uint64_t hash) {
  const float a = static_cast<float>(hash & 0xFFFFFF) * 0x1p-24F * 2 * std::numbers::pi_v<float>;
  const float r2 = static_cast<float>(hash >> 40) * 0x1p-24F;
  const Eigen::Vector3f helper =
      std::abs(normal.x()) < 0.7F ? Eigen::Vector3f::UnitX() : Eigen::Vector3f::UnitY();
  const Eigen::Vector3f s = normal.cross(helper).normalized(), t = normal.cross(s);
  return (std::sqrt(r2) * (std::cos(a) * s + std::sin(a) * t) + std::sqrt(1 - r2) * normal).normalized();
}

}  // namespace

Rgb depthColour(float part) {
  static const std::array<Rgb, 256> kRamp = makeRamp();
  return kRamp[static_cast<std::size_t>(std::lround(std::clamp(part, 0.0F, 1.0F) * 255))];
}

MeshView fitView(const Mesh& mesh, const PictureOptions& options, int margin_right_px) {
  MeshView view;
  view.right = Eigen::Vector3f::UnitY();  // east
  if (options.view == PictureOptions::View::kTop) {
    view.forward = Eigen::Vector3f::UnitZ();
  } else {
    view.forward = Eigen::Vector3f(std::cos(kElevation), 0, std::sin(kElevation));  // looking north and down
  }
  view.down = view.forward.cross(view.right);
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::max()), high = -low;
  for (const auto& triangle : mesh.triangles) {
    for (std::uint32_t i : triangle) {
      const Eigen::Vector3f& v = mesh.vertices[i];
      const Eigen::Array3f p(v.dot(view.right), v.dot(view.down), v.dot(view.forward));
      low = low.min(p);
      high = high.max(p);
    }
  }
  constexpr float kLeastSize = 1e-3F;  // [m]
  const Eigen::Array3f size = (high - low).max(kLeastSize);
  const float usable_width =
      static_cast<float>(options.width) * (1 - 2 * kBorder) - static_cast<float>(margin_right_px);
  const float usable_height = static_cast<float>(options.height) * (1 - 2 * kBorder);
  view.px_per_m = std::min(std::max(1.0F, usable_width) / size.x(), usable_height / size.y());
  const float width_m = static_cast<float>(options.width - margin_right_px) / view.px_per_m;
  const float height_m = static_cast<float>(options.height) / view.px_per_m;
  view.corner = view.right * (0.5F * (low.x() + high.x()) - 0.5F * width_m) +
                view.down * (0.5F * (low.y() + high.y()) - 0.5F * height_m) +
                view.forward * (low.z() - size.x());
  view.depth_m = size.z() + 2 * size.x();
  return view;
}

cv::Mat shadeMesh(const Mesh& mesh, const MeshView& view, const PictureOptions& options, float shallow_m,
                  float deep_m) {
  SurfaceScene scene(view.corner.cast<double>());
  TriangleSurface surface;
  const float range = std::max(1e-6F, deep_m - shallow_m);
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Rgb colour =
        mesh.colours.empty() ? depthColour((mesh.vertices[i].z() - shallow_m) / range) : mesh.colours[i];
    surface.covers.push_back({colour, 0});
    surface.vertices.push_back(mesh.vertices[i] - view.corner);
  }
  Mesh with_normals;
  with_normals.vertices = mesh.vertices;
  with_normals.triangles = mesh.triangles;
  computeNormals(with_normals);
  surface.normals = std::move(with_normals.normals);
  surface.triangles = mesh.triangles;
  scene.add(std::move(surface));
  scene.commit();

  const float gain = brightening(mesh);
  const float sky_reach = kSkyReach * static_cast<float>(options.width) / view.px_per_m;
  const float lift = 1e-4F * sky_reach;
  const float level_sun = -kSun.z();
  const auto shade = [&](const Eigen::Vector2f& pixel, std::uint64_t hash) {
    const Eigen::Vector3f start = (view.right * pixel.x() + view.down * pixel.y()) / view.px_per_m;
    const std::optional<SurfaceHit> hit = scene.firstHit(start, view.forward, view.depth_m);
    if (!hit)
      return Eigen::Array3f(linearFromSrgb(kBackground[0]), linearFromSrgb(kBackground[1]),
                            linearFromSrgb(kBackground[2]));
    const SurfacePoint point = scene.look(hit->geometry, hit->primitive, hit->u, hit->v, 0.0F);
    const Eigen::Vector3f flat =
        hit->normal.dot(view.forward) > 0 ? Eigen::Vector3f(-hit->normal) : hit->normal;
    const Eigen::Vector3f normal = point.normal.dot(flat) < 0 ? Eigen::Vector3f(-point.normal) : point.normal;
    const Eigen::Vector3f foot = start + hit->distance_m * view.forward + lift * flat;
    float sun = std::max(0.0F, normal.dot(kSun));
    if (sun > 0 && scene.occluded(foot, kSun, 10 * sky_reach)) sun = 0;
    int open = 0;
    for (int i = 0; i < kSkyRays; ++i) {
      hash = hash64(hash);
      open += !scene.occluded(foot, skyDirection(flat, hash), sky_reach);
    }
    const float sky = static_cast<float>(open) / kSkyRays * (0.75F - 0.25F * normal.z());
    const float light = gain * (kSunShare * sun / level_sun + (1 - kSunShare) * sky);
    return Eigen::Array3f(light * point.albedo[0], light * point.albedo[1], light * point.albedo[2]);
  };

  cv::Mat picture(options.height, options.width, CV_8UC3);
  oneapi::tbb::parallel_for(0, options.height, [&](int y) {
    for (int x = 0; x < options.width; ++x) {
      Eigen::Array3f sum = Eigen::Array3f::Zero();
      for (int k = 0; k < kSide * kSide; ++k) {
        const Eigen::Vector2f pixel(static_cast<float>(x) + (static_cast<float>(k % kSide) + 0.5F) / kSide,
                                    static_cast<float>(y) + (static_cast<float>(k / kSide) + 0.5F) / kSide);
        sum += shade(pixel, hash64(static_cast<std::uint64_t>((y * options.width + x) * kSide * kSide + k)));
      }
      sum /= kSide * kSide;
      picture.at<cv::Vec3b>(y, x) = {srgbFromLinear(static_cast<double>(sum[2])),
                                     srgbFromLinear(static_cast<double>(sum[1])),
                                     srgbFromLinear(static_cast<double>(sum[0]))};
    }
  });
  return picture;
}

}  // namespace fathom::sim
