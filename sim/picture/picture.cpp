#include "sim/picture/picture.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/order_statistics.hpp"
#include "sim/picture/mesh_view.hpp"

namespace fathom::sim {
namespace {

const cv::Scalar kInk(60, 50, 40);  // BGR

// Size of letters that suits the picture.
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

// Depths at 1 % and 99 % of the vertices: a stray point does not take the whole ramp.
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
