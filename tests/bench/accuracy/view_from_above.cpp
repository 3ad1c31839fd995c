#include "tests/bench/accuracy/view_from_above.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

namespace fathom::accuracy {
namespace {

constexpr float kNothing = std::numeric_limits<float>::infinity();

// Texels no finer than half a pixel of the canvas.
cv::Mat atlasFor(const TexturedTile& tile, double pixel) {
  const RgbImage& atlas = tile.atlas;
  const cv::Mat whole(atlas.height, atlas.width, CV_8UC3, const_cast<std::uint8_t*>(atlas.rgb.data()));
  int factor = 1;
  while (tile.texel * factor * 2 <= pixel && factor < 8) factor *= 2;
  cv::Mat out;
  cv::resize(whole, out, cv::Size(std::max(1, atlas.width / factor), std::max(1, atlas.height / factor)), 0,
             0, cv::INTER_AREA);
  out.convertTo(out, CV_32FC3);
  return out;
}

cv::Vec3f bilinear(const cv::Mat& image, double x, double y) {
  x = std::clamp(x, 0.0, image.cols - 1.0);
  y = std::clamp(y, 0.0, image.rows - 1.0);
  const int x0 = std::min(static_cast<int>(x), std::max(0, image.cols - 2));
  const int y0 = std::min(static_cast<int>(y), std::max(0, image.rows - 2));
  const int x1 = std::min(x0 + 1, image.cols - 1), y1 = std::min(y0 + 1, image.rows - 1);
  const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  return (1 - fy) * ((1 - fx) * image.at<cv::Vec3f>(y0, x0) + fx * image.at<cv::Vec3f>(y0, x1)) +
         fy * ((1 - fx) * image.at<cv::Vec3f>(y1, x0) + fx * image.at<cv::Vec3f>(y1, x1));
}

}  // namespace

ViewFromAbove::ViewFromAbove(const Canvas& c)
    : canvas(c),
      colour(c.rows, c.columns, CV_32FC3, cv::Scalar::all(0)),
      depth(c.rows, c.columns, CV_32F, cv::Scalar(kNothing)) {}

void drawTile(const TexturedTile& tile, ViewFromAbove& view) {
  const Mesh& mesh = tile.surface.mesh;
  const Canvas& canvas = view.canvas;
  const bool textured = !tile.atlas.empty() && !mesh.texture_coordinates.empty();
  const cv::Mat atlas = textured ? atlasFor(tile, canvas.pixel) : cv::Mat();
  for (const auto& t : mesh.triangles) {
    std::array<double, 3> x{}, y{};
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = (static_cast<double>(mesh.vertices[t[k]].y()) - canvas.west) / canvas.pixel - 0.5;
      y[k] = (canvas.north - static_cast<double>(mesh.vertices[t[k]].x())) / canvas.pixel - 0.5;
    }
    const double area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    if (area == 0) continue;
    const auto [x_low, x_high] = std::minmax_element(x.begin(), x.end());
    const auto [y_low, y_high] = std::minmax_element(y.begin(), y.end());
    if (*x_high < 0 || *y_high < 0 || *x_low > canvas.columns || *y_low > canvas.rows) continue;
    for (int row = std::max(0, static_cast<int>(std::ceil(*y_low)));
         row <= std::min(canvas.rows - 1, static_cast<int>(std::floor(*y_high))); ++row) {
      for (int column = std::max(0, static_cast<int>(std::ceil(*x_low)));
           column <= std::min(canvas.columns - 1, static_cast<int>(std::floor(*x_high))); ++column) {
        const double b = ((column - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (row - y[0])) / area;
        const double c = ((x[1] - x[0]) * (row - y[0]) - (column - x[0]) * (y[1] - y[0])) / area;
        constexpr double kRounding = 1e-9;
        if (b < -kRounding || c < -kRounding || b + c > 1 + kRounding) continue;
        const std::array<double, 3> w = {1 - b - c, b, c};
        double depth = 0;
        for (std::size_t k = 0; k < 3; ++k) depth += w[k] * static_cast<double>(mesh.vertices[t[k]].z());
        auto& nearest = view.depth.at<float>(row, column);
        if (static_cast<float>(depth) >= nearest) continue;
        nearest = static_cast<float>(depth);
        cv::Vec3f& colour = view.colour.at<cv::Vec3f>(row, column);
        if (textured) {
          double s = 0, v = 0;
          for (std::size_t k = 0; k < 3; ++k) {
            s += w[k] * static_cast<double>(mesh.texture_coordinates[t[k]].x());
            v += w[k] * static_cast<double>(mesh.texture_coordinates[t[k]].y());
          }
          colour = bilinear(atlas, s * atlas.cols - 0.5, (1 - v) * atlas.rows - 0.5);
        } else if (!mesh.colours.empty()) {
          colour = {};
          for (std::size_t k = 0; k < 3; ++k)
            for (int i = 0; i < 3; ++i)
              colour[i] += static_cast<float>(w[k]) *
                           static_cast<float>(mesh.colours[t[k]][static_cast<std::size_t>(i)]);
        }
      }
    }
  }
}

ViewFromAbove drawTruth(const sim::Appearance& truth, const ViewFromAbove& like, const SE3& T_truth_model,
                        const Eigen::Vector2d& shift) {
  constexpr double kAbove = 100.0;  // from where it is looked at [m]
  constexpr int kSamples = 2;       // along each side of a pixel: a pixel is an area
  ViewFromAbove out(like.canvas);
  tbb::parallel_for(0, like.canvas.rows, [&](int row) {
    for (int column = 0; column < like.canvas.columns; ++column) {
      const float depth = like.depth.at<float>(row, column);
      if (!std::isfinite(depth)) continue;
      const Eigen::Vector3d place =
          T_truth_model *
          Eigen::Vector3d(like.canvas.northOf(row), like.canvas.eastOf(column), static_cast<double>(depth));
      cv::Vec3f sum(0, 0, 0);
      double down = 0;
      bool seen_all = true;
      for (int k = 0; k < kSamples * kSamples && seen_all; ++k) {
        const double north = ((k / kSamples + 0.5) / kSamples - 0.5) * like.canvas.pixel;
        const double east = ((k % kSamples + 0.5) / kSamples - 0.5) * like.canvas.pixel;
        const auto seen =
            truth.look({place.x() + shift.x() + north, place.y() + shift.y() + east, place.z() - kAbove},
                       Eigen::Vector3d::UnitZ(), like.canvas.pixel / kSamples);
        seen_all = seen.has_value();
        if (!seen) continue;
        down += seen->point.z() / (kSamples * kSamples);
        for (int c = 0; c < 3; ++c)
          sum[c] += 255.0F / (kSamples * kSamples) * seen->albedo[static_cast<std::size_t>(c)] * seen->facing;
      }
      if (!seen_all) continue;
      out.depth.at<float>(row, column) = static_cast<float>(down);
      out.colour.at<cv::Vec3f>(row, column) = sum;
    }
  });
  return out;
}

}  // namespace fathom::accuracy
