#include "sim/sea/ground/texture_image.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

constexpr int kLevels = 5;  // a footprint of 16 texels; beyond that surveys do not fly

std::array<float, 256> makeSrgbTable() {
  std::array<float, 256> table{};
  for (int i = 0; i < 256; ++i) {
    const double v = i / 255.0;
    table[static_cast<std::size_t>(i)] =
        static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
  }
  return table;
}

const std::array<float, 256> kLinear = makeSrgbTable();

}  // namespace

float linearFromSrgb(std::uint8_t value) {
  return kLinear[value];
}

std::uint8_t srgbFromLinear(double value) {
  const double v = std::clamp(value, 0.0, 1.0);
  const double s = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::lround(255.0 * s));
}

Rgb srgbFromLinear(const Eigen::Vector3d& linear) {
  return {srgbFromLinear(linear.x()), srgbFromLinear(linear.y()), srgbFromLinear(linear.z())};
}

TextureImage::TextureImage(const std::filesystem::path& path) {
  cv::Mat image;
  try {
    image = cv::imread(path, cv::IMREAD_COLOR);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty())
    throw InputError(path, "", "cannot be read as an image; give a JPEG, PNG or TIFF texture");
  cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
  if (image.cols < 2 || image.rows < 2)
    throw InputError(path, "", "is smaller than 2 x 2 pixels; give a texture image");
  *this = TextureImage(image.cols, image.rows, {image.datastart, image.dataend});
}

TextureImage::TextureImage(int width, int height, const std::vector<std::uint8_t>& rgb) {
  levels_.push_back({width, height, rgb});
  for (int i = 1; i < kLevels && levels_.back().width >= 4 && levels_.back().height >= 4; ++i) {
    Level& whole = levels_.back();
    Level level{whole.width / 2, whole.height / 2, {}};
    level.rgb.resize(3 * static_cast<std::size_t>(level.width) * static_cast<std::size_t>(level.height));
    cv::Mat half(level.height, level.width, CV_8UC3, level.rgb.data());
    cv::resize(cv::Mat(whole.height, whole.width, CV_8UC3, whole.rgb.data()), half, half.size(), 0, 0,
               cv::INTER_AREA);
    levels_.push_back(std::move(level));
  }
}

std::array<float, 3> TextureImage::sample(const Eigen::Vector2f& st, float texels) const {
  std::size_t index = 0;
  while (index + 1 < levels_.size() && texels > 1.5F) {
    texels *= 0.5F;
    ++index;
  }
  const Level& level = levels_[index];
  const float x =
      std::clamp(st.x() * static_cast<float>(level.width) - 0.5F, 0.0F, static_cast<float>(level.width - 1));
  const float y = std::clamp((1.0F - st.y()) * static_cast<float>(level.height) - 0.5F, 0.0F,
                             static_cast<float>(level.height - 1));
  const int x0 = std::min(static_cast<int>(x), level.width - 2),
            y0 = std::min(static_cast<int>(y), level.height - 2);
  const float u = x - static_cast<float>(x0), v = y - static_cast<float>(y0);
  const std::uint8_t* top =
      &level.rgb[3 * (static_cast<std::size_t>(y0) * static_cast<std::size_t>(level.width) +
                      static_cast<std::size_t>(x0))];
  const std::uint8_t* bottom = top + 3 * static_cast<std::size_t>(level.width);
  std::array<float, 3> colour{};
  for (std::size_t c = 0; c < 3; ++c) {
    const float a = kLinear[top[c]] * (1 - u) + kLinear[top[c + 3]] * u;
    const float b = kLinear[bottom[c]] * (1 - u) + kLinear[bottom[c + 3]] * u;
    colour[c] = a * (1 - v) + b * v;
  }
  return colour;
}

}  // namespace fathom::sim
