#include "recon/topside/calibration/chart_images.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/topside/calibration/chart_finder.hpp"

namespace fathom::topside {
namespace {

using calibration::kChartColumns;
using calibration::kChartRows;

// Corners of the outer patches from their centres, in steps from patch to patch: patches are 1 wide and 1.1
// apart.
constexpr double kHalf = 0.5 / 1.1;

// Each channel stretched to its own brightest, in 8 bits, blue first.
cv::Mat stretchedBgr(const ImageView& image) {
  const cv::Mat in(image.height, image.width,
                   image.format == PixelFormat::kRgb ? (image.bits == 8 ? CV_8UC3 : CV_16UC3)
                                                     : (image.bits == 8 ? CV_8UC1 : CV_16UC1),
                   const_cast<void*>(image.data), image.stride);
  cv::Mat rgb, out;
  if (image.format == PixelFormat::kRgb)
    rgb = in;
  else
    cv::cvtColor(in, rgb, cv::COLOR_BayerRGGB2RGB);
  rgb.convertTo(rgb, CV_32F);
  std::vector<cv::Mat> channels;
  cv::split(rgb, channels);
  for (cv::Mat& channel : channels) {
    cv::Mat sorted = channel.reshape(1, 1).clone();
    cv::sort(sorted, sorted, cv::SORT_ASCENDING);
    constexpr double kBrightest = 0.995;
    const float top = sorted.at<float>(static_cast<int>(kBrightest * (sorted.cols - 1)));
    cv::pow(cv::min(channel / std::max(top, 1.0F), 1.0), image.bits == 8 ? 1.0 : 1 / 2.2, channel);
  }
  std::reverse(channels.begin(), channels.end());
  cv::merge(channels, out);
  out.convertTo(out, CV_8U, 255);
  return out;
}

// Sums of linear samples in part of a patch.
struct LightSum {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), count = Eigen::Vector3d::Zero();
  bool clipped = false;
};
void addSamples(const ImageView& image, const std::vector<cv::Point>& quad, LightSum& out) {
  const cv::Rect box = cv::boundingRect(quad) & cv::Rect(0, 0, image.width, image.height);
  cv::Mat mask = cv::Mat::zeros(box.size(), CV_8UC1);
  std::vector<cv::Point> within;
  for (const cv::Point& p : quad) within.push_back(p - box.tl());
  cv::fillConvexPoly(mask, within, 255);
  constexpr double kClipped = 0.98;
  const double full = (1 << image.bits) - 1;
  const bool rgb = image.format == PixelFormat::kRgb;
  for (int y = 0; y < box.height; ++y)
    for (int x = 0; x < box.width; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      const auto* line =
          static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(box.y + y) * image.stride;
      for (int k = 0; k < (rgb ? 3 : 1); ++k) {
        const int c = rgb ? k : (box.x + x) % 2 + (box.y + y) % 2;
        const auto at = static_cast<std::size_t>(rgb ? 3 * (box.x + x) + k : box.x + x);
        const double sample =
            (image.bits == 8 ? line[at] : reinterpret_cast<const std::uint16_t*>(line)[at]) / full;
        out.clipped = out.clipped || sample >= kClipped;
        out.sum(c) += rgb && image.bits == 8 ? linearFromSrgb(line[at]) : sample;
        out.count(c) += 1;
      }
    }
}

// Mean of each channel in the middle of a patch, without the parts that are clearly brighter than its darkest
// third: reflections of lamps and of waves only add light. None where it is clipped or samples are few.
std::optional<Eigen::Vector3d> patchMean(const ImageView& image, const ChartPlace& place, int column,
                                         int row) {
  constexpr double kMiddle = 0.225;  // of a patch's step, from its centre
  constexpr int kAcross = 3;         // parts
  constexpr std::size_t kDarkest = 3;
  constexpr double kReflecting = 1.05;  // light over that of the darkest third
  constexpr double kFewest = 9;         // samples
  constexpr double kPart = 2 * kMiddle / kAcross;
  std::vector<LightSum> parts;
  for (int i = 0; i < kAcross * kAcross; ++i) {
    const double x = column - kMiddle + kPart * (i % kAcross), whole = i / kAcross,
                 y = row - kMiddle + kPart * whole;
    const std::vector<cv::Point2d> part{{x, y}, {x + kPart, y}, {x + kPart, y + kPart}, {x, y + kPart}};
    std::vector<cv::Point2d> quad;
    cv::perspectiveTransform(part, quad, place);
    addSamples(image, std::vector<cv::Point>(quad.begin(), quad.end()), parts.emplace_back());
    if (parts.back().count.minCoeff() == 0) return std::nullopt;
  }
  const auto light = [](const LightSum& c) { return c.sum.cwiseQuotient(c.count).sum(); };
  std::sort(parts.begin(), parts.end(),
            [&](const LightSum& a, const LightSum& b) { return light(a) < light(b); });
  const double dark = light(parts[kDarkest - 1]);
  LightSum all;
  for (const LightSum& part : parts) {
    if (light(part) > kReflecting * dark) break;
    if (part.clipped) return std::nullopt;
    all.sum += part.sum, all.count += part.count;
  }
  if (all.count.minCoeff() < kFewest) return std::nullopt;
  return all.sum.cwiseQuotient(all.count);
}

// What the camera saw on the patches of a chart at `place`.
calibration::ChartView readPatches(const ImageView& image, const ChartPlace& place, const std::string& name) {
  calibration::ChartView view;
  view.name = name;
  view.rendered = image.format == PixelFormat::kRgb && image.bits == 8;
  for (int k = 0; k < calibration::kPatches; ++k)
    view.patches[static_cast<std::size_t>(k)] = patchMean(image, place, k % kChartColumns, k / kChartColumns);
  return view;
}

ChartPlace placeAt(const ChartCorners& corners, const ImageView& image, const std::string& file) {
  std::vector<cv::Point2f> to;
  for (const Eigen::Vector2d& p : corners) {
    if (!(p.x() >= 0 && p.y() >= 0 && p.x() < image.width && p.y() < image.height))
      throw InputError(file, "--corners", "a corner is outside the image");
    to.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  const auto low = static_cast<float>(-kHalf), right = static_cast<float>(kChartColumns - 1 + kHalf),
             bottom = static_cast<float>(kChartRows - 1 + kHalf);
  return cv::getPerspectiveTransform(
      std::vector<cv::Point2f>{{low, low}, {right, low}, {right, bottom}, {low, bottom}}, to);
}

}  // namespace

std::vector<calibration::ChartView> readCharts(const std::filesystem::path& file, Samples samples,
                                               const std::optional<ChartCorners>& corners) {
  const io::ImageFile image = readSamples(file, samples);
  if (image.view.format == PixelFormat::kMono)
    throw InputError(file.string(), "",
                     "is grey; give --format, such as bayer-rggb, or another camera's image");
  if (corners) {
    calibration::ChartView view =
        readPatches(image.view, placeAt(*corners, image.view, file.string()), file.string());
    if (const auto agreement = calibration::agreementOf(view); agreement && *agreement < calibration::kAgrees)
      throw InputError(
          file.string(), "--corners",
          "the colours there are not those of a chart of 24 patches; give the corners of dark skin, "
          "bluish green, black and white");
    return {view};
  }
  struct Candidate {
    double agreement = calibration::kAgrees;
    ChartPlace place;
    calibration::ChartView view;
  };
  std::vector<Candidate> candidates;
  bool clipped = false;
  for (const std::vector<ChartPlace>& places : chartPlaces(stretchedBgr(image.view))) {
    Candidate best;
    bool readable = places.empty();
    for (const ChartPlace& place : places) {
      calibration::ChartView view = readPatches(image.view, place, file.string());
      const auto agreement = calibration::agreementOf(view);
      readable = readable || agreement;
      if (agreement && *agreement >= best.agreement) best = {*agreement, place, std::move(view)};
    }
    clipped = clipped || !readable;
    if (!best.view.name.empty()) candidates.push_back(std::move(best));
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.agreement > b.agreement; });
  // The best of several lattices on one chart.
  std::vector<ChartPlace> taken;
  std::vector<calibration::ChartView> out;
  for (Candidate& one : candidates) {
    const auto inside = [&](const ChartPlace& other) {
      const cv::Vec3d middle =
          other.inv() * one.place * cv::Vec3d(0.5 * (kChartColumns - 1), 0.5 * (kChartRows - 1), 1);
      const double x = middle[0] / middle[2], y = middle[1] / middle[2];
      return x > -kHalf && x < kChartColumns - 1 + kHalf && y > -kHalf && y < kChartRows - 1 + kHalf;
    };
    if (std::any_of(taken.begin(), taken.end(), inside)) continue;
    taken.push_back(one.place);
    out.push_back(std::move(one.view));
  }
  if (out.empty())
    throw InputError(file.string(), "",
                     clipped ? "shows squares like those of a chart, but most are clipped; expose less"
                             : "shows no chart of 24 patches that could be found; give --corners");
  for (std::size_t k = 0; k < out.size() && out.size() > 1; ++k)
    out[k].name += ", chart " + std::to_string(k + 1);
  return out;
}

}  // namespace fathom::topside
