#include "sim/score/colour_detail.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "sim/sea/ground/texture_image.hpp"

namespace fathom::sim {
namespace {

using Cells = std::vector<ColourCell>;

std::string quantilesOf(std::vector<double> errors) {
  std::sort(errors.begin(), errors.end());
  return formatted("%7.2f %6.2f", quantile(errors, 0.5), quantile(errors, 0.95));
}

std::string byQuantity(const char* name, const Cells& all, double ColourCell::*of) {
  Cells cells;
  for (const ColourCell& cell : all)
    if (std::isfinite(cell.*of)) cells.push_back(cell);
  if (cells.size() < 3 * kFewestSquares) return "";
  std::sort(cells.begin(), cells.end(),
            [&](const ColourCell& a, const ColourCell& b) { return a.*of < b.*of; });
  std::string out = formatted("    %-10s", name);
  for (std::size_t k = 0; k <= 3; ++k) out += formatted(" %6.2f", cells[k * (cells.size() - 1) / 3].*of);
  std::vector<double> quantity, lightness;
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<double> errors;
    for (std::size_t i = k * cells.size() / 3; i < (k + 1) * cells.size() / 3; ++i)
      errors.push_back(cells[i].error);
    out += "  " + quantilesOf(errors);
  }
  for (const ColourCell& cell : cells) {
    quantity.push_back(cell.*of);
    lightness.push_back(labOf(cell.product).x() - labOf(cell.truth).x());
  }
  return out + formatted("   lightness %+.2f\n", correlation(lightness, quantity));
}

cv::Vec3b srgbPixel(const Eigen::Vector3d& linear) {
  cv::Vec3b out;
  for (int c = 0; c < 3; ++c) out[2 - c] = srgbFromLinear(std::clamp(linear(c), 0.0, 1.0));
  return out;
}

}  // namespace

const char* colourName(const Eigen::Vector3d& lab) {
  constexpr double kDark = 35, kWhite = 75, kGrey = 8;
  const double chroma = lab.tail<2>().norm(), turn = kDegreesPerRadian;
  if (lab.x() < kDark) return "dark";
  if (chroma < kGrey) return lab.x() > kWhite ? "white" : "grey";
  const double hue = std::fmod(turn * std::atan2(lab.z(), lab.y()) + 360, 360);
  struct Sector {
    double to;  // [deg]
    const char* name;
  };
  constexpr std::array<Sector, 7> kSectors{{{40, "pink"},
                                            {75, "brown"},
                                            {105, "beige"},
                                            {200, "green"},
                                            {280, "blue"},
                                            {335, "violet"},
                                            {361, "pink"}}};
  return std::find_if(kSectors.begin(), kSectors.end(), [&](const Sector& s) { return hue < s.to; })->name;
}

std::string colourDetail(const ColourScore& score) {
  std::string out = byQuantity("range [m]", score.squares, &ColourCell::range) +
                    byQuantity("depth [m]", score.squares, &ColourCell::depth) +
                    byQuantity("height [1]", score.squares, &ColourCell::height);
  std::map<std::string, std::vector<double>> named;
  for (const ColourCell& cell : score.squares) named[colourName(labOf(cell.truth))].push_back(cell.error);
  for (const auto& [name, errors] : named)
    if (errors.size() >= kFewestSquares)
      out += formatted("    %-10s %s %9zu\n", name.c_str(), quantilesOf(errors).c_str(), errors.size());
  return out;
}

void writeColourMap(const std::filesystem::path& file, const ColourScore& score) {
  if (score.squares.empty()) return;
  const auto indexOf = [](double metres) { return static_cast<int>(std::floor(metres / kColourCell)); };
  int north0 = INT32_MAX, north1 = INT32_MIN, east0 = INT32_MAX, east1 = INT32_MIN;
  for (const ColourCell& cell : score.squares) {
    north0 = std::min(north0, indexOf(cell.point.x())), north1 = std::max(north1, indexOf(cell.point.x()));
    east0 = std::min(east0, indexOf(cell.point.y())), east1 = std::max(east1, indexOf(cell.point.y()));
  }
  const int width = east1 - east0 + 1, height = north1 - north0 + 1;
  constexpr int kWanted = 640, kTitle = 28, kGap = 12;  // [px]
  const int scale = std::clamp(kWanted / std::max(width, height), 1, 8);
  std::array<cv::Mat, 3> panels;
  for (cv::Mat& panel : panels) panel = cv::Mat::zeros(height, width, CV_8UC3);
  cv::Mat level = cv::Mat::zeros(height, width, CV_8UC1), colours;
  const auto levelOf = [](double error) { return cv::saturate_cast<std::uint8_t>(255 * error / kMostError); };
  for (const ColourCell& cell : score.squares) {
    const int row = north1 - indexOf(cell.point.x()), column = indexOf(cell.point.y()) - east0;
    panels[0].at<cv::Vec3b>(row, column) = srgbPixel(cell.truth);
    panels[1].at<cv::Vec3b>(row, column) = srgbPixel(cell.product);
    level.at<std::uint8_t>(row, column) = levelOf(cell.error);
  }
  cv::applyColorMap(level, colours, cv::COLORMAP_INFERNO);
  for (const ColourCell& cell : score.squares) {
    const int row = north1 - indexOf(cell.point.x()), column = indexOf(cell.point.y()) - east0;
    panels[2].at<cv::Vec3b>(row, column) = colours.at<cv::Vec3b>(row, column);
  }
  const int panel_width = std::max(scale * width, 180);
  cv::Mat page(kTitle + scale * height + kTitle, 3 * (panel_width + kGap), CV_8UC3, cv::Scalar::all(255));
  const std::array<std::string, 3> titles{
      "truth", "product, one white balance",
      formatted("CIEDE2000: median %.2f, 95 %% %.2f", score.median, score.p95)};
  for (int k = 0; k < 3; ++k) {
    const int left = k * (panel_width + kGap);
    cv::Mat large;
    cv::resize(panels[static_cast<std::size_t>(k)], large, {}, scale, scale, cv::INTER_NEAREST);
    large.copyTo(page(cv::Rect(left, kTitle, large.cols, large.rows)));
    cv::putText(page, titles[static_cast<std::size_t>(k)], {left + 2, 19}, cv::FONT_HERSHEY_SIMPLEX, 0.42, {},
                1, cv::LINE_AA);
  }
  // The error's scale, below its panel.
  const int left = 2 * (panel_width + kGap), top = kTitle + scale * height + 6;
  cv::Mat ramp(10, 120, CV_8UC1), coloured;
  for (int x = 0; x < ramp.cols; ++x) ramp.col(x).setTo(255 * x / (ramp.cols - 1));
  cv::applyColorMap(ramp, coloured, cv::COLORMAP_INFERNO);
  coloured.copyTo(page(cv::Rect(left + 16, top, ramp.cols, ramp.rows)));
  cv::putText(page, "0", {left + 2, top + 10}, cv::FONT_HERSHEY_SIMPLEX, 0.4, {}, 1, cv::LINE_AA);
  cv::putText(page, decimals(kMostError, 0), {left + 142, top + 10}, cv::FONT_HERSHEY_SIMPLEX, 0.4, {}, 1,
              cv::LINE_AA);
  std::vector<std::uint8_t> png;
  cv::imencode(".png", page, png);
  AtomicFile out(file);
  out.stream().write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  out.commit();
}

}  // namespace fathom::sim
