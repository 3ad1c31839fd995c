#include "sim/picture/picture.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/sea/ground/noise.hpp"
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

// Gain that brings the brightest 5 % of a mesh's colours to a light grey, so that dark seafloor is visible.
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

// A cosine-weighted direction over the surface.
Eigen::Vector3f skyDirection(const Eigen::Vector3f& normal, std::uint64_t hash) {
  const float a = static_cast<float>(hash & 0xFFFFFF) * 0x1p-24F * 2 * std::numbers::pi_v<float>;
  const float r2 = static_cast<float>(hash >> 40) * 0x1p-24F;
  const Eigen::Vector3f helper =
      std::abs(normal.x()) < 0.7F ? Eigen::Vector3f::UnitX() : Eigen::Vector3f::UnitY();
  const Eigen::Vector3f s = normal.cross(helper).normalized(), t = normal.cross(s);
  return (std::sqrt(r2) * (std::cos(a) * s + std::sin(a) * t) + std::sqrt(1 - r2) * normal).normalized();
}

// A parallel projection that shows a whole mesh.
struct MeshView {
  Eigen::Vector3f right, down, forward;  // unit, of the picture, in nav
  Eigen::Vector3f corner;                // nav point of pixel (0, 0)'s corner, in front of everything
  float px_per_m = 1;
  float depth_m = 1;  // along `forward` from in front of the mesh to behind it
};

// Colour of a part of the depth range, 0 shallow to 1 deep (viridis).
Rgb depthColour(float part) {
  static const std::array<Rgb, 256> kRamp = makeRamp();
  return kRamp[static_cast<std::size_t>(std::lround(std::clamp(part, 0.0F, 1.0F) * 255))];
}

// The view of a whole mesh, with a border, and `margin_right_px` free for a legend.
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

// The shaded picture, BGR; a mesh without colours by depth between `shallow_m` and `deep_m`.
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
        const int column = k % kSide, row = k / kSide;
        const Eigen::Vector2f pixel(static_cast<float>(x) + (static_cast<float>(column) + 0.5F) / kSide,
                                    static_cast<float>(y) + (static_cast<float>(row) + 0.5F) / kSide);
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

const cv::Scalar kInk(60, 50, 40);  // BGR

// Scale of the font for the picture's height.
double fontScale(const PictureOptions& options) {
  return std::max(0.35, options.height / 1500.0);
}

void write(cv::Mat& picture, const std::string& text, const cv::Point& left_bottom, double scale) {
  cv::putText(picture, text, left_bottom, cv::FONT_HERSHEY_SIMPLEX, scale, kInk, scale > 0.5 ? 2 : 1,
              cv::LINE_AA);
}

// A bar of a round length, 1, 2 or 5 times a power of ten, near a fifth of the picture.
void drawScaleBar(cv::Mat& picture, const MeshView& view, const PictureOptions& options) {
  const double wish_m = 0.2 * options.width / static_cast<double>(view.px_per_m);
  const double power = std::pow(10.0, std::floor(std::log10(wish_m)));
  const double length_m = power * (wish_m >= 5 * power ? 5 : wish_m >= 2 * power ? 2 : 1);
  const int length = static_cast<int>(std::lround(length_m * static_cast<double>(view.px_per_m)));
  const int x = options.width / 40, y = options.height - options.height / 30,
            tick = std::max(3, options.height / 160);
  const int stroke = std::max(1, options.height / 480);
  cv::line(picture, {x, y}, {x + length, y}, kInk, stroke, cv::LINE_AA);
  cv::line(picture, {x, y - tick}, {x, y + tick}, kInk, stroke, cv::LINE_AA);
  cv::line(picture, {x + length, y - tick}, {x + length, y + tick}, kInk, stroke, cv::LINE_AA);
  write(picture, decimals(length_m, length_m < 1 ? 2 : 0) + " m", {x, y - 2 * tick}, fontScale(options));
}

void drawDepthLegend(cv::Mat& picture, const PictureOptions& options, int margin, float shallow, float deep) {
  const int left = options.width - margin * 3 / 4, width = margin / 6;
  const int top = options.height / 6, bottom = options.height * 5 / 6;
  for (int y = top; y <= bottom; ++y) {
    const Rgb c = depthColour(static_cast<float>(y - top) / static_cast<float>(bottom - top));
    cv::line(picture, {left, y}, {left + width, y}, cv::Scalar(c[2], c[1], c[0]));
  }
  const double scale = fontScale(options);
  write(picture, "depth", {left, top - options.height / 40}, scale);
  constexpr int kLabels = 5;
  for (int i = 0; i < kLabels; ++i) {
    const float part = static_cast<float>(i) / (kLabels - 1);
    const int y = top + static_cast<int>(part * static_cast<float>(bottom - top));
    write(picture, decimals(static_cast<double>(shallow + part * (deep - shallow)), 2) + " m",
          {left + width + margin / 20, y + static_cast<int>(9 * scale)}, scale * 0.8);
  }
}

// Depths at 1 % and 99 % of the vertices, robust against stray points.
std::pair<float, float> depthRange(const Mesh& mesh) {
  std::vector<float> depths;
  depths.reserve(mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) depths.push_back(mesh.vertices[triangle[0]].z());
  const auto at = [&](double part) {
    return ranked(std::span(depths), static_cast<std::size_t>(part * static_cast<double>(depths.size() - 1)));
  };
  const float shallow = at(0.01), deep = at(0.99);
  return {shallow, std::max(deep, shallow + 1e-3F)};
}

}  // namespace

void drawPicture(const std::filesystem::path& mesh_file, const std::filesystem::path& png,
                 const PictureOptions& options) {
  constexpr int kLeastSide = 64, kGreatestSide = 16384;  // [px]
  for (int side : {options.width, options.height})
    if (side < kLeastSide || side > kGreatestSide)
      throw InputError("--size", std::to_string(side), "is out of range; give 64 to 16384 pixels");
  const Mesh mesh = readPly(mesh_file);
  if (mesh.empty()) throw InputError(mesh_file, "", "holds no triangles; there is nothing to draw");
  const auto [shallow, deep] = depthRange(mesh);
  const int margin = mesh.colours.empty() ? options.width / 7 : 0;
  const MeshView view = fitView(mesh, options, margin);
  cv::Mat picture = shadeMesh(mesh, view, options, shallow, deep);
  drawScaleBar(picture, view, options);
  if (margin > 0) drawDepthLegend(picture, options, margin, shallow, deep);

  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) throw std::runtime_error("PNG encoding failed");
  writeFile(png, bytes);
}

}  // namespace fathom::sim
