#pragma once

#include <algorithm>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "firmware_if/predive/predive_watch.hpp"

namespace fathom::test {

inline constexpr int kWidth = 320, kHeight = 240;

// Tiles of random grey, noise on top, blurred by `blur` pixels; `light` scales it.
inline std::vector<std::uint8_t> syntheticPicture(double blur, double light) {
  std::mt19937 random(11);
  cv::Mat image(kHeight, kWidth, CV_32F);
  for (int y = 0; y < kHeight; y += 16)
    for (int x = 0; x < kWidth; x += 16)
      image(cv::Rect(x, y, 16, 16)) = 0.1 + 0.5 * static_cast<double>(random() % 1000) / 1000;
  if (blur > 0) cv::GaussianBlur(image, image, {}, blur);
  std::normal_distribution<double> noise(0, 0.005);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(kWidth) * kHeight);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const double level =
        light * image.at<float>(static_cast<int>(i) / kWidth, static_cast<int>(i) % kWidth) + noise(random);
    bytes[i] = static_cast<std::uint8_t>(std::clamp(level, 0.0, 1.0) * 255);
  }
  return bytes;
}

inline ImageView viewOf(const std::vector<std::uint8_t>& bytes) {
  return {bytes.data(), kWidth, kHeight, kWidth, PixelFormat::kMono, 8};
}

}  // namespace fathom::test
