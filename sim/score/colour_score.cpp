#include "sim/score/colour_score.hpp"

#include <gdal_priv.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "sim/score/surface_score.hpp"
#include "sim/sea/ground/texture_image.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kPoints = 300'000;  // sampled from a product
constexpr double kDarkest = 1e-4;         // least linear value with a colour

Eigen::Vector3d linearOf(const std::uint8_t* rgb) {
  return Eigen::Vector3f(linearFromSrgb(rgb[0]), linearFromSrgb(rgb[1]), linearFromSrgb(rgb[2]))
      .cast<double>();
}

// Sums of what falls into one square.
struct SquareSums {
  Eigen::Vector3d product = Eigen::Vector3d::Zero(), truth = Eigen::Vector3d::Zero(),
                  point = Eigen::Vector3d::Zero();
  double count = 0;
};

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

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = static_cast<Eigen::Index>(a.size());
  const Eigen::ArrayXd x = Eigen::Map<const Eigen::ArrayXd>(a.data(), n),
                       y = Eigen::Map<const Eigen::ArrayXd>(b.data(), n);
  const Eigen::ArrayXd dx = x - x.mean(), dy = y - y.mean();
  const double power = std::sqrt(dx.square().sum() * dy.square().sum());
  return power > 0 ? (dx * dy).sum() / power : 0;
}

std::vector<ColouredPoint> colouredPoints(const Mesh& mesh) {
  std::vector<ColouredPoint> out;
  if (mesh.colours.size() != mesh.vertices.size()) return out;
  forSurface(mesh, kPoints,
             [&](const std::array<std::uint32_t, 3>& t, double u, double v, const Eigen::Vector3d& point) {
               const auto at = [&](std::size_t k) { return linearOf(mesh.colours[t[k]].data()); };
               out.push_back({point, (1 - u - v) * at(0) + u * at(1) + v * at(2)});
             });
  return out;
}

std::vector<ColouredPoint> colouredPoints(const std::filesystem::path& orthomosaic, const TruthSurface& truth,
                                          const SE3& T_truth_nav) {
  GDALAllRegister();
  const std::unique_ptr<GDALDataset> set(
      GDALDataset::Open(orthomosaic.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
  std::array<double, 6> place{};
  if (!set || set->GetRasterCount() < 3 || set->GetGeoTransform(place.data()) != CE_None || place[2] != 0 ||
      place[4] != 0)
    throw InputError(orthomosaic.string(), "", "is no image in colour from above, north up");
  const int width = set->GetRasterXSize(), height = set->GetRasterYSize();
  const double pixels = static_cast<double>(width) * height;
  const int every = std::max(1, static_cast<int>(std::sqrt(pixels / static_cast<double>(kPoints))));
  constexpr double kAbove = 100;  // [m]
  const std::size_t squares = static_cast<std::size_t>((width + every - 1) / every);
  std::vector<std::uint8_t> row(4 * static_cast<std::size_t>(width));
  std::vector<Eigen::Vector3d> sums(squares);
  std::vector<int> seen(squares);
  std::vector<ColouredPoint> out;
  for (int y = 0; y < height; ++y) {
    std::array<int, 4> bands{1, 2, 3, 4};
    const int count = std::min(4, set->GetRasterCount());
    if (set->RasterIO(GF_Read, 0, y, width, 1, row.data(), width, 1, GDT_Byte, count, bands.data(), 4,
                      static_cast<GSpacing>(4) * width, 1) != CE_None)
      throw InputError(orthomosaic.string(), "row " + std::to_string(y), "cannot be read");
    if (y % every == 0) {
      std::fill(sums.begin(), sums.end(), Eigen::Vector3d::Zero());
      std::fill(seen.begin(), seen.end(), 0);
    }
    for (int x = 0; x < width; ++x) {
      const std::uint8_t* pixel = &row[4 * static_cast<std::size_t>(x)];
      constexpr std::uint8_t kOpaque = 255;
      if (count == 4 && pixel[3] != kOpaque) continue;
      sums[static_cast<std::size_t>(x / every)] += linearOf(pixel);
      ++seen[static_cast<std::size_t>(x / every)];
    }
    if (y % every != every - 1) continue;
    for (std::size_t k = 0; k < squares; ++k) {
      if (seen[k] < every * every) continue;
      const double x = static_cast<double>(k) * every + 0.5 * every;
      const double east = place[0] + x * place[1], north = place[3] + (y + 1 - 0.5 * every) * place[5];
      const auto below = truth.castRay(T_truth_nav * Eigen::Vector3d(north, east, -kAbove),
                                       T_truth_nav.rotation() * Eigen::Vector3d::UnitZ());
      if (below) out.push_back({T_truth_nav.inverse() * *below, sums[k] / seen[k]});
    }
  }
  return out;
}

std::optional<ColourScore> scoreColours(const std::vector<ColouredPoint>& points, const TruthSurface& truth,
                                        const SE3& T_truth_nav, const Camera& camera,
                                        const std::vector<SE3>& cameras) {
  constexpr double kFar = 0.1;  // of the truth: another surface [m]
  std::map<std::pair<std::int32_t, std::int32_t>, SquareSums> cells;
  for (const ColouredPoint& p : points) {
    const Eigen::Vector3d at = T_truth_nav * p.point;
    const TruthSurface::Nearest nearest = truth.nearest(at);
    if (nearest.distance > kFar) continue;
    SquareSums& cell = cells[{static_cast<std::int32_t>(std::floor(at.x() / kColourCell)),
                              static_cast<std::int32_t>(std::floor(at.y() / kColourCell))}];
    cell.product += p.linear;
    cell.truth += nearest.linear;
    cell.point += at;
    ++cell.count;
  }
  std::vector<SquareSums> all;
  for (auto& [place, cell] : cells) {
    cell.product /= cell.count, cell.truth /= cell.count, cell.point /= cell.count;
    if (cell.product.minCoeff() > kDarkest && cell.truth.minCoeff() > kDarkest) all.push_back(cell);
  }
  if (all.empty()) return {};
  ColourScore out;
  for (Eigen::Index c = 0; c < 3; ++c) {
    std::vector<double> ratios;
    for (const SquareSums& cell : all) ratios.push_back(cell.truth(c) / cell.product(c));
    out.gains(c) = median(ratios);
  }
  std::vector<double> errors, chroma, depths, ranges;
  for (const SquareSums& cell : all) {
    ColourCell& square = out.squares.emplace_back();
    square = {cell.point, cell.truth, cell.product.cwiseProduct(out.gains)};
    const Eigen::Vector3d a = labOf(square.truth), b = labOf(square.product);
    square.error = ciede2000(a, b);
    square.depth = cell.point.z();
    square.range = std::numeric_limits<double>::infinity();
    const SE3* nearest = nullptr;
    for (const SE3& pose : cameras) {
      const double range = (pose.translation() - cell.point).norm();
      if (range < square.range) square.range = range, nearest = &pose;
    }
    square.height = std::numeric_limits<double>::quiet_NaN();
    if (nearest != nullptr) {
      const Eigen::Vector3d p = nearest->inverse() * cell.point;
      const double height = p.z() > 0 ? camera.project(p).y() / (camera.height - 1.0) : -1;
      if (height >= 0 && height <= 1) square.height = height;
    }
    errors.push_back(square.error);
    chroma.push_back((a - b).tail<2>().norm());
    depths.push_back(square.depth);
    ranges.push_back(square.range);
  }
  out.with_depth = correlation(errors, depths);
  out.with_range = cameras.empty() ? 0 : correlation(errors, ranges);
  out.chroma = median(chroma);
  std::sort(errors.begin(), errors.end());
  out.median = quantile(errors, 0.5);
  out.p95 = quantile(errors, 0.95);
  return out;
}

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
  for (int x = 0; x < ramp.cols; ++x) {
    const int grey = 255 * x / (ramp.cols - 1);
    ramp.col(x).setTo(grey);
  }
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
