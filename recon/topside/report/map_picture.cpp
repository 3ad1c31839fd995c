#include "recon/topside/report/map_picture.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "recon/geometry/triangles.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint8_t kBackground = 255;
// Light from the north-west, 45 degrees up (the cartographers' convention), and how dark shade is.
const Eigen::Vector3f kToLight = Eigen::Vector3f(0.5F, -0.5F, -0.7071F);
constexpr float kAmbient = 0.35F;

}  // namespace

void MapExtent::add(const Mesh& part) {
  for (const auto& v : part.vertices) {
    low_ = low_.min(v.head<2>().cast<double>().array());
    high_ = high_.max(v.head<2>().cast<double>().array());
    ++depths_[v.z()];
  }
  vertices_ += part.vertices.size();
}

double MapExtent::depthAt(std::size_t percent) const {
  const std::size_t rank = (vertices_ - 1) * percent / 100;
  std::size_t below = 0;
  for (const auto& [depth, count] : depths_)
    if ((below += count) > rank) return static_cast<double>(depth);
  return 0;
}

MapPainter::MapPainter(const MapExtent& extent, int max_pixels, double min_metres) {
  if (extent.empty()) return;
  const Eigen::Array2d span = extent.high() - extent.low();
  picture_.shallowest = extent.depthAt(1);
  picture_.deepest = extent.depthAt(99);
  picture_.metres_per_pixel = std::max(min_metres, span.maxCoeff() / max_pixels);
  picture_.north = extent.high().x();
  picture_.west = extent.low().y();
  const auto pixels = [&](double metres) {
    return std::clamp(static_cast<int>(std::ceil(metres / picture_.metres_per_pixel)), 1, max_pixels);
  };
  picture_.width = pixels(span.y());
  picture_.height = pixels(span.x());
  seen_.resize(static_cast<std::size_t>(picture_.width) * static_cast<std::size_t>(picture_.height));
}

void MapPainter::add(const Mesh& part) {
  if (part.normals.size() != part.vertices.size()) {
    Mesh with_normals = part;
    computeNormals(with_normals);
    return add(with_normals);
  }
  for (const auto& t : part.triangles) {
    std::array<Eigen::Vector2d, 3> p;  // (row, column)
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d v = part.vertices[t[k]].cast<double>();
      p[k] = {(picture_.north - v.x()) / picture_.metres_per_pixel - 0.5,
              (v.y() - picture_.west) / picture_.metres_per_pixel - 0.5};
    }
    scanTriangle(
        p, picture_.height, picture_.width, [&](int row, int column, const std::array<double, 3>& shares) {
          float depth = 0;
          Eigen::Vector3f normal = Eigen::Vector3f::Zero();
          std::array<float, 3> colour{};
          for (std::size_t k = 0; k < 3; ++k) {
            const auto w = static_cast<float>(shares[k]);
            depth += w * part.vertices[t[k]].z();
            normal += w * part.normals[t[k]];
            if (!part.colours.empty())
              for (std::size_t c = 0; c < 3; ++c) colour[c] += w * static_cast<float>(part.colours[t[k]][c]);
          }
          Seen& pixel = seen_[static_cast<std::size_t>(row) * static_cast<std::size_t>(picture_.width) +
                              static_cast<std::size_t>(column)];
          if (depth >= pixel.depth) return;
          const float lambert = std::max(0.0F, normal.normalized().dot(kToLight));
          pixel = {depth, kAmbient + (1 - kAmbient) * lambert / -kToLight.z(), colour};
        });
  }
}

MapPicture MapPainter::take() {
  cv::Mat scale(1, 256, CV_8UC1), colours;
  for (int k = 0; k < 256; ++k)
    scale.at<std::uint8_t>(0, k) = static_cast<std::uint8_t>(255 - k);  // deep is dark
  cv::applyColorMap(scale, colours, cv::COLORMAP_VIRIDIS);
  picture_.rgb.assign(seen_.size() * 3, kBackground);
  picture_.rgb_texture.assign(seen_.size() * 3, kBackground);
  const double span = std::max(picture_.deepest - picture_.shallowest, 1e-3);
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    if (!std::isfinite(seen_[k].depth)) continue;
    const double s = (static_cast<double>(seen_[k].depth) - picture_.shallowest) / span;
    const auto& bgr = colours.at<cv::Vec3b>(0, static_cast<int>(std::clamp(s, 0.0, 1.0) * 255));
    for (std::size_t c = 0; c < 3; ++c) {
      const auto shaded = [&](float value) {
        return static_cast<std::uint8_t>(std::min(255.0F, value * seen_[k].shade));
      };
      picture_.rgb[k * 3 + c] = shaded(static_cast<float>(bgr[static_cast<int>(2 - c)]));
      picture_.rgb_texture[k * 3 + c] = shaded(seen_[k].colour[c]);
    }
  }
  return std::move(picture_);
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
