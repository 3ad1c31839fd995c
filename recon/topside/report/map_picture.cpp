#include "recon/topside/report/map_picture.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "recon/geometry/order_statistics.hpp"
#include "recon/geometry/triangle_scan.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint8_t kBackground = 255;
// Light from the north-west, 45 degrees up (the cartographers' convention), and how dark shade is.
const Eigen::Vector3f kToLight = Eigen::Vector3f(0.5F, -0.5F, -0.7071F);
constexpr float kAmbient = 0.35F;

struct Seen {
  float depth = INFINITY;
  float shade = 0;
  std::array<float, 3> colour{};
};

// Uppermost surface at each pixel's middle.
std::vector<Seen> rasterise(const Mesh& mesh, const MapPicture& frame) {
  std::vector<Seen> seen(static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height));
  for (const auto& t : mesh.triangles) {
    std::array<Eigen::Vector2d, 3> p;  // (row, column)
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d v = mesh.vertices[t[k]].cast<double>();
      p[k] = {(frame.north - v.x()) / frame.metres_per_pixel - 0.5,
              (v.y() - frame.west) / frame.metres_per_pixel - 0.5};
    }
    scanTriangle(p, frame.height, frame.width, [&](int row, int column, const std::array<double, 3>& shares) {
      float depth = 0;
      Eigen::Vector3f normal = Eigen::Vector3f::Zero();
      std::array<float, 3> colour{};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto w = static_cast<float>(shares[k]);
        depth += w * mesh.vertices[t[k]].z();
        normal += w * mesh.normals[t[k]];
        if (!mesh.colours.empty())
          for (std::size_t c = 0; c < 3; ++c) colour[c] += w * static_cast<float>(mesh.colours[t[k]][c]);
      }
      Seen& pixel = seen[static_cast<std::size_t>(row) * static_cast<std::size_t>(frame.width) +
                         static_cast<std::size_t>(column)];
      if (depth >= pixel.depth) return;
      const float lambert = std::max(0.0F, normal.normalized().dot(kToLight));
      pixel = {depth, kAmbient + (1 - kAmbient) * lambert / -kToLight.z(), colour};
    });
  }
  return seen;
}

}  // namespace

MapPicture drawFromAbove(const Mesh& mesh, int max_pixels, double min_metres) {
  MapPicture picture;
  if (mesh.empty()) return picture;
  Mesh with_normals;
  if (mesh.normals.size() != mesh.vertices.size()) {
    with_normals = mesh;
    computeNormals(with_normals);
  }
  const Mesh& drawn = with_normals.empty() ? mesh : with_normals;
  Eigen::Vector2d low = drawn.vertices[0].head<2>().cast<double>(), high = low;
  std::vector<float> depths;
  for (const auto& v : drawn.vertices) {
    low = low.cwiseMin(v.head<2>().cast<double>());
    high = high.cwiseMax(v.head<2>().cast<double>());
    depths.push_back(v.z());
  }
  const auto percentile = [&](std::size_t percent) {
    return static_cast<double>(ranked(std::span(depths), (depths.size() - 1) * percent / 100));
  };
  picture.shallowest = percentile(1);
  picture.deepest = percentile(99);
  picture.metres_per_pixel = std::max(min_metres, (high - low).maxCoeff() / max_pixels);
  picture.north = high.x();
  picture.west = low.y();
  const auto pixels = [&](double metres) {
    return std::clamp(static_cast<int>(std::ceil(metres / picture.metres_per_pixel)), 1, max_pixels);
  };
  picture.width = pixels(high.y() - low.y());
  picture.height = pixels(high.x() - low.x());

  const std::vector<Seen> seen = rasterise(drawn, picture);
  cv::Mat scale(1, 256, CV_8UC1), colours;
  for (int k = 0; k < 256; ++k)
    scale.at<std::uint8_t>(0, k) = static_cast<std::uint8_t>(255 - k);  // deep is dark
  cv::applyColorMap(scale, colours, cv::COLORMAP_VIRIDIS);
  picture.rgb.assign(seen.size() * 3, kBackground);
  picture.rgb_texture.assign(seen.size() * 3, kBackground);
  const double span = std::max(picture.deepest - picture.shallowest, 1e-3);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    if (!std::isfinite(seen[k].depth)) continue;
    const double s = (static_cast<double>(seen[k].depth) - picture.shallowest) / span;
    const auto& bgr = colours.at<cv::Vec3b>(0, static_cast<int>(std::clamp(s, 0.0, 1.0) * 255));
    for (std::size_t c = 0; c < 3; ++c) {
      const auto shaded = [&](float value) {
        return static_cast<std::uint8_t>(std::min(255.0F, value * seen[k].shade));
      };
      picture.rgb[k * 3 + c] = shaded(static_cast<float>(bgr[static_cast<int>(2 - c)]));
      picture.rgb_texture[k * 3 + c] = shaded(seen[k].colour[c]);
    }
  }
  return picture;
}

std::string toPng(const std::vector<std::uint8_t>& rgb, int width, int height) {
  cv::Mat bgr(height, width, CV_8UC3);
  for (std::size_t k = 0; k < rgb.size(); k += 3)
    bgr.at<cv::Vec3b>(static_cast<int>(k / 3) / width, static_cast<int>(k / 3) % width) = {
        rgb[k + 2], rgb[k + 1], rgb[k]};
  std::vector<std::uint8_t> bytes;
  if (rgb.empty() || !cv::imencode(".png", bgr, bytes))
    throw std::runtime_error("a picture cannot be encoded as PNG");
  return {bytes.begin(), bytes.end()};
}

}  // namespace fathom::topside
