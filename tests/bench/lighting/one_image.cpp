#include "tests/bench/lighting/one_image.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "recon/lighting/lighting_model.hpp"

namespace fathom::bench {
namespace {

constexpr int kColumns = 24, kRows = 20;  // cells
using Surface = Eigen::Matrix<double, 6, 1>;

Surface terms(double u, double v) {
  Surface t;
  t << 1, u, v, u * u, u * v, v * v;
  return t;
}

// Iteratively reweighted least squares with Cauchy's weights: a stone or a fish has little say.
Surface fit(const std::vector<double>& log_means) {
  constexpr int kRounds = 10;
  constexpr double kScale = 0.2;  // of what the seafloor does to a cell
  Surface surface = Surface::Zero();
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
    Surface right = Surface::Zero();
    for (int j = 0; j < kRows; ++j)
      for (int i = 0; i < kColumns; ++i) {
        const Surface t = terms((i + 0.5) / kColumns - 0.5, (j + 0.5) / kRows - 0.5);
        const double value = log_means[static_cast<std::size_t>(j * kColumns + i)];
        const double error = round == 0 ? 0 : (value - t.dot(surface)) / kScale;
        const double weight = 1 / (1 + error * error);
        information += weight * t * t.transpose();
        right += weight * value * t;
      }
    surface = information.ldlt().solve(right);
  }
  return surface;
}

cv::Mat colour(const io::ImageFile& file, const std::vector<std::uint8_t>& corrected, PixelFormat format) {
  const int width = file.view.width, height = file.view.height;
  const std::size_t channels = format == PixelFormat::kRgb ? 3 : 1;
  cv::Mat rgb(height, width, CV_8UC3), bgr, small;
  lighting::demosaicRgb(
      {corrected.data(), width, height, static_cast<std::size_t>(width) * channels, format, 8}, rgb.data);
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  cv::resize(bgr, small, {}, 0.3, 0.3, cv::INTER_AREA);
  return small;
}

}  // namespace

void correctOneImage(const std::filesystem::path& image, const std::filesystem::path& png) {
  io::ImageFile file = io::readAnyImage(image);
  // A left camera's name says that its grey samples are a mosaic.
  const auto name = image.filename().string();
  if (file.view.format == PixelFormat::kMono && name.find("_LC") != std::string::npos)
    file.view.format = PixelFormat::kBayerRggb;
  const PixelFormat format = file.view.format;
  const int width = file.view.width, height = file.view.height;
  const int channels = format == PixelFormat::kRgb ? 3 : 1;
  const double full = (1 << file.view.bits) - 1;
  const auto sample = [&](int x, int y, int c) {
    const auto* row =
        static_cast<const std::uint8_t*>(file.view.data) + static_cast<std::size_t>(y) * file.view.stride;
    const int at = x * channels + c;
    return (file.view.bits == 8 ? row[at] : reinterpret_cast<const std::uint16_t*>(row)[at]) / full;
  };
  const auto colourAt = [&](int x, int y, int c) {
    if (format != PixelFormat::kBayerRggb) return c;
    return y % 2 == 0 ? (x % 2 == 0 ? 0 : 1) : (x % 2 == 0 ? 1 : 2);
  };
  const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height * channels);
  std::vector<std::uint8_t> raw(size), whole(size), smooth(size);

  std::array<std::vector<double>, 3> sums, counts;
  sums.fill(std::vector<double>(kColumns * kRows));
  counts = sums;
  const auto each = [&](const auto& function) {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < channels; ++c)
          function(x, y, c, static_cast<std::size_t>((y * width + x) * channels + c));
  };
  each([&](int x, int y, int c, std::size_t at) {
    const double value = sample(x, y, c);
    raw[at] = static_cast<std::uint8_t>(std::lround(255 * value));
    const auto colour_index = static_cast<std::size_t>(colourAt(x, y, c));
    const auto cell = static_cast<std::size_t>(y * kRows / height * kColumns + x * kColumns / width);
    sums[colour_index][cell] += value;
    counts[colour_index][cell] += 1;
  });
  std::array<Surface, 3> surfaces;
  constexpr std::array<const char*, 3> kNames = {"red", "green", "blue"};
  for (std::size_t c = 0; c < 3; ++c) {
    surfaces[c].setZero();
    if (counts[c][0] == 0) continue;
    std::vector<double> log_means;
    double mean = 0, before = 0, after = 0;
    for (std::size_t k = 0; k < sums[c].size(); ++k) {
      log_means.push_back(std::log(std::max(sums[c][k] / counts[c][k], 1e-4)));
      mean += log_means.back() / static_cast<double>(sums[c].size());
    }
    surfaces[c] = fit(log_means);
    for (int j = 0; j < kRows; ++j)
      for (int i = 0; i < kColumns; ++i) {
        const double value = log_means[static_cast<std::size_t>(j * kColumns + i)];
        before += std::pow(value - mean, 2);
        after +=
            std::pow(value - terms((i + 0.5) / kColumns - 0.5, (j + 0.5) / kRows - 0.5).dot(surfaces[c]), 2);
      }
    std::printf("%-6s cells differ by %.3f (rms, in logarithms), by %.3f after the smooth surface\n",
                kNames[c], std::sqrt(before / (kColumns * kRows)), std::sqrt(after / (kColumns * kRows)));
  }
  const auto reflected = [&](int x, int y, int c) {  // in parts of the surface: its mean is about 1
    const Surface& surface = surfaces[static_cast<std::size_t>(colourAt(x, y, c))];
    return sample(x, y, c) / std::exp(terms((x + 0.5) / width - 0.5, (y + 0.5) / height - 0.5).dot(surface));
  };
  std::array<double, 3> n{}, squares{};
  each([&](int x, int y, int c, std::size_t) {
    const auto k = static_cast<std::size_t>(colourAt(x, y, c));
    n[k] += 1;
    squares[k] += std::pow(reflected(x, y, c) - 1, 2);
  });
  const lighting::LightingConfig config;
  each([&](int x, int y, int c, std::size_t at) {
    const auto k = static_cast<std::size_t>(colourAt(x, y, c));
    const double gain = config.target_sigma / std::sqrt(squares[k] / n[k]);
    const double value = config.target_mean + gain * (reflected(x, y, c) - 1);
    smooth[at] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(value, 0.0, 1.0)));
  });
  lighting::LightingModel model(width, height, format, file.view.bits, {});
  model.add(file.view);
  model.correct(file.view, whole.data());
  cv::Mat row;
  cv::hconcat(std::vector<cv::Mat>{colour(file, raw, format), colour(file, whole, format),
                                   colour(file, smooth, format)},
              row);
  cv::imwrite(png.string(), row);
  std::printf(
      "One image cannot tell the light's pattern from the scene. Left: as it is; middle: the whole image's\n"
      "mean and deviation; right: the same after dividing by a smooth surface, which takes broad slopes of\n"
      "the seafloor's own brightness with it.\n");
}

}  // namespace fathom::bench
