#include "recon/products/rasters/layer_picture.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

constexpr int kMargin = 14, kHead = 40, kFoot = 78, kLeast = 420;  // [px]
const cv::Scalar kInk(50, 50, 50);
constexpr double kTitle = 0.6;     // of OpenCV's font, 22 px high
constexpr double kAmbient = 0.45;  // of shading

cv::Mat rampTable(const std::string& name) {
  static const std::map<std::string, int> kRamps = {{"viridis", cv::COLORMAP_VIRIDIS},
                                                    {"magma", cv::COLORMAP_MAGMA},
                                                    {"turbo", cv::COLORMAP_TURBO},
                                                    {"cividis", cv::COLORMAP_CIVIDIS},
                                                    {"twilight", cv::COLORMAP_TWILIGHT}};
  cv::Mat steps(1, 256, CV_8U), table;
  for (int k = 0; k < 256; ++k) steps.at<std::uint8_t>(0, k) = static_cast<std::uint8_t>(k);
  const auto found = kRamps.find(name);
  cv::applyColorMap(steps, table, found == kRamps.end() ? cv::COLORMAP_VIRIDIS : found->second);
  return table;
}

void write(cv::Mat& image, const std::string& text, int x, int y, double scale) {
  cv::putText(image, text, {x, y}, cv::FONT_HERSHEY_SIMPLEX, scale, kInk, 1, cv::LINE_AA);
}
int widthOf(const std::string& text, double scale) {
  int baseline = 0;
  return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, 1, &baseline).width;
}

std::string numberText(double value, double range) {
  const int digits = std::clamp(static_cast<int>(std::ceil(1.3 - std::log10(std::max(range, 1e-9)))), 0, 6);
  return decimals(value, digits);
}

// Light of the north-west, 45 degrees up; 1 on level ground.
double shade(const ReducedRaster& raster, int x, int y) {
  const auto at = [&](int i, int j) {
    return static_cast<double>(raster.values[static_cast<std::size_t>(std::clamp(j, 0, raster.height - 1)) *
                                                 static_cast<std::size_t>(raster.width) +
                                             static_cast<std::size_t>(std::clamp(i, 0, raster.width - 1))]);
  };
  const double east = (at(x + 1, y) - at(x - 1, y)) / (2 * raster.pixel);
  const double north = (at(x, y - 1) - at(x, y + 1)) / (2 * raster.pixel);
  if (!std::isfinite(east) || !std::isfinite(north)) return 1;
  const double lit =
      (east * 0.5 - north * 0.5 + 0.7071) / std::sqrt(1 + east * east + north * north) / 0.7071;
  return kAmbient + (1 - kAmbient) * std::clamp(lit, 0.0, 1.35);
}

void drawLegend(cv::Mat& image, const PictureText& text, const cv::Mat& table, int top) {
  const int left = kMargin, width = std::min(240, image.cols - 2 * kMargin - 140), height = 14;
  for (int x = 0; x < width; ++x)
    cv::line(image, {left + x, top}, {left + x, top + height},
             cv::Scalar(table.at<cv::Vec3b>(0, x * 255 / (width - 1))));
  cv::rectangle(image, {left, top}, {left + width, top + height}, kInk);
  const std::string low = numberText(text.min, text.max - text.min),
                    high = numberText(text.max, text.max - text.min) + " " + text.unit;
  write(image, low, left, top + height + 18, 0.45);
  write(image, high, std::max(left + widthOf(low, 0.45) + 12, left + width - widthOf(high, 0.45)),
        top + height + 18, 0.45);
}

void drawScale(cv::Mat& image, double metres_per_pixel, int top) {
  const double most = 110 * metres_per_pixel;
  double length = std::pow(10.0, std::floor(std::log10(most)));
  for (const double times : {5.0, 2.0})
    if (length * times <= most) {
      length *= times;
      break;
    }
  const int pixels = std::max(2, static_cast<int>(std::lround(length / metres_per_pixel)));
  const int right = image.cols - kMargin;
  cv::line(image, {right - pixels, top + 10}, {right, top + 10}, kInk, 2);
  const std::string text = numberText(length, length * 10) + " m";
  write(image, text, right - widthOf(text, 0.45), top + 32, 0.45);
}

}  // namespace

Rgb rampColour(const std::string& ramp, double part) {
  const auto bgr =
      rampTable(ramp).at<cv::Vec3b>(0, static_cast<int>(std::lround(255 * std::clamp(part, 0.0, 1.0))));
  return {bgr[2], bgr[1], bgr[0]};
}

void drawLayer(const std::filesystem::path& path, const ReducedRaster& raster, const PictureText& text,
               bool shaded) {
  const int zoom = std::max(1, kLeast / std::max(raster.width, raster.height));
  const int width = std::max({raster.width * zoom, kLeast, widthOf(text.title, kTitle)});
  cv::Mat image(raster.height * zoom + kHead + kFoot, width + 2 * kMargin, CV_8UC3, cv::Scalar::all(255));
  const cv::Mat table = rampTable(text.ramp);
  cv::Mat map(raster.height, raster.width, CV_8UC3, cv::Scalar::all(255));
  for (int y = 0; y < raster.height; ++y) {
    for (int x = 0; x < raster.width; ++x) {
      const auto k =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(raster.width) + static_cast<std::size_t>(x);
      cv::Vec3b& to = map.at<cv::Vec3b>(y, x);
      if (!raster.rgba.empty()) {
        const std::uint8_t* c = &raster.rgba[4 * k];
        if (c[3] != 0) to = {c[2], c[1], c[0]};
        continue;
      }
      const double value = static_cast<double>(raster.values[k]);
      if (std::isnan(value)) continue;
      const double range = text.max > text.min ? text.max - text.min : 1;
      to = table.at<cv::Vec3b>(
          0, static_cast<int>(std::lround(255 * std::clamp((value - text.min) / range, 0.0, 1.0))));
      if (shaded) {
        const double light = shade(raster, x, y);
        for (int c = 0; c < 3; ++c) to[c] = cv::saturate_cast<std::uint8_t>(to[c] * light);
      }
    }
  }
  cv::resize(map, map, {}, zoom, zoom, cv::INTER_NEAREST);
  map.copyTo(image(cv::Rect(kMargin, kHead, map.cols, map.rows)));
  write(image, text.title, kMargin, 26, kTitle);
  const int foot = kHead + map.rows + 20;
  if (!text.ramp.empty()) drawLegend(image, text, table, foot);
  drawScale(image, raster.pixel / zoom, foot);
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", image, bytes)) throw std::runtime_error("a quicklook cannot be encoded");
  writeFile(path, bytes);
}

}  // namespace fathom::topside
