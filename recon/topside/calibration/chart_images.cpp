#include "recon/topside/calibration/chart_images.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/mcc.hpp>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/lighting/lighting_model.hpp"

namespace fathom::topside {
namespace {

using calibration::kChartColumns;
using calibration::kChartRows;

// Patches are 1 wide and kStep apart on the chart.
constexpr double kStep = 1.1, kBorder = 0.1;
constexpr double kAcross = kStep * (kChartColumns - 1) + 1, kDown = kStep * (kChartRows - 1) + 1;

// For the eye, and for mcc: each channel stretched to its own brightest, in 8 bits, blue first.
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

ChartCorners findCorners(const ImageView& image, const std::filesystem::path& file) {
  const auto detector = cv::mcc::CCheckerDetector::create();
  const cv::Mat bgr = stretchedBgr(image);
  if (!detector->process(bgr, cv::mcc::MCC24) || detector->getListColorChecker().empty())
    throw InputError(file.string(), "", "shows no chart of 24 patches that could be found; give --corners");
  const std::vector<cv::Point2f> box = detector->getBestColorChecker()->getBox();
  // The box has a border about the patches.
  const std::vector<cv::Point2f> chart{
      {static_cast<float>(-kBorder), static_cast<float>(-kBorder)},
      {static_cast<float>(kAcross + kBorder), static_cast<float>(-kBorder)},
      {static_cast<float>(kAcross + kBorder), static_cast<float>(kDown + kBorder)},
      {static_cast<float>(-kBorder), static_cast<float>(kDown + kBorder)}};
  std::vector<cv::Point2f> corners;
  cv::perspectiveTransform(std::vector<cv::Point2f>{{0, 0},
                                                    {static_cast<float>(kAcross), 0},
                                                    {static_cast<float>(kAcross), static_cast<float>(kDown)},
                                                    {0, static_cast<float>(kDown)}},
                           corners, cv::getPerspectiveTransform(chart, box));
  ChartCorners out;
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = {corners[k].x, corners[k].y};
  return out;
}

// Mean of a channel's samples in a quadrilateral; none where one is clipped.
std::optional<Eigen::Vector3d> meanWithin(const ImageView& image, const std::vector<cv::Point>& quad) {
  const cv::Rect box = cv::boundingRect(quad) & cv::Rect(0, 0, image.width, image.height);
  cv::Mat mask = cv::Mat::zeros(box.size(), CV_8UC1);
  std::vector<cv::Point> within;
  for (const cv::Point& p : quad) within.push_back(p - box.tl());
  cv::fillConvexPoly(mask, within, 255);
  constexpr double kClipped = 0.98;
  const double full = (1 << image.bits) - 1;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), count = Eigen::Vector3d::Zero();
  for (int y = 0; y < box.height; ++y)
    for (int x = 0; x < box.width; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0) continue;
      const auto* line =
          static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(box.y + y) * image.stride;
      const bool rgb = image.format == PixelFormat::kRgb;
      for (int k = 0; k < (rgb ? 3 : 1); ++k) {
        const int c = rgb ? k : (box.x + x) % 2 + (box.y + y) % 2;
        const auto at = static_cast<std::size_t>(rgb ? 3 * (box.x + x) + k : box.x + x);
        const double sample =
            (image.bits == 8 ? line[at] : reinterpret_cast<const std::uint16_t*>(line)[at]) / full;
        if (sample >= kClipped) return std::nullopt;
        sum(c) += rgb && image.bits == 8 ? linearFromSrgb(sample) : sample;
        count(c) += 1;
      }
    }
  constexpr double kFewest = 9;  // samples
  if (count.minCoeff() < kFewest) return std::nullopt;
  return sum.cwiseQuotient(count);
}

}  // namespace

calibration::ChartView readChart(const std::filesystem::path& file, Samples samples,
                                 const std::optional<ChartCorners>& corners) {
  const io::ImageFile image = readSamples(file, samples);
  if (image.view.format == PixelFormat::kMono)
    throw InputError(file.string(), "",
                     "is grey; give --format, such as bayer-rggb, or another camera's image");
  const ChartCorners at = corners ? *corners : findCorners(image.view, file);
  std::vector<cv::Point2f> to;
  for (const Eigen::Vector2d& p : at) {
    if (!(p.x() >= 0 && p.y() >= 0 && p.x() < image.view.width && p.y() < image.view.height))
      throw InputError(file.string(), "--corners", "a corner is outside the image");
    to.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  const cv::Mat place = cv::getPerspectiveTransform(
      std::vector<cv::Point2f>{{0, 0},
                               {static_cast<float>(kAcross), 0},
                               {static_cast<float>(kAcross), static_cast<float>(kDown)},
                               {0, static_cast<float>(kDown)}},
      to);
  calibration::ChartView view;
  view.name = file.string();
  for (int k = 0; k < calibration::kPatches; ++k) {
    const double x = kStep * (k % kChartColumns), y = kStep * (k / kChartColumns);
    constexpr double kIn = 0.25, kOut = 0.75;  // the patch's middle
    const std::vector<cv::Point2d> middle{
        {x + kIn, y + kIn}, {x + kOut, y + kIn}, {x + kOut, y + kOut}, {x + kIn, y + kOut}};
    std::vector<cv::Point2d> quad;
    cv::perspectiveTransform(middle, quad, place);
    view.patches[static_cast<std::size_t>(k)] =
        meanWithin(image.view, std::vector<cv::Point>(quad.begin(), quad.end()));
  }
  return view;
}

}  // namespace fathom::topside
