#include "recon/lighting/lighting_model.hpp"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "recon/lighting/pixel_statistics.hpp"

namespace fathom::lighting {
namespace {

constexpr int kMaxSide = 65535;     // [px]
constexpr int kMaxGrid = 256;       // [px]
constexpr int kSolveAlways = 64;    // images up to which every image is followed by a solution
constexpr int kSolveFraction = 32;  // later, one in this share of the images so far

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("lighting model: ") + what);
}

std::vector<Channel> channelsOf(int width, int height, PixelFormat format) {
  switch (format) {
    case PixelFormat::kMono:
      return {{0, 0, 1, 1, width, height}};
    case PixelFormat::kRgb:
      return {{0, 0, 3, 1, width, height}, {1, 0, 3, 1, width, height}, {2, 0, 3, 1, width, height}};
    case PixelFormat::kBayerRggb:
      break;
  }
  std::vector<Channel> channels;
  for (int row = 0; row < 2; ++row)
    for (int column = 0; column < 2; ++column)
      channels.push_back({column, row, 2, 2, (width + 1 - column) / 2, (height + 1 - row) / 2});
  return channels;
}

// out = clamp(255 (gain * sample / full_scale + offset)), rounded.
template <typename T>
void correctSamples(const T* in, const float* gain, const float* offset, float scale, int n,
                    std::uint8_t* out) {
  constexpr float kFull = 255.0F, kRound = 0.5F;
  for (int i = 0; i < n; ++i) {
    const float v = static_cast<float>(in[i]) * scale * gain[i] + kFull * offset[i];
    out[i] = static_cast<std::uint8_t>(std::min(std::max(v, 0.0F), kFull) + kRound);
  }
}

}  // namespace

struct LightingModel::Impl {
  int width, height;
  PixelFormat format;
  int bits;
  LightingConfig config;
  int samples_per_pixel;
  float full_scale;
  std::vector<PixelStatistics> channels;
  int images = 0, solved_images = 0;
  std::uint64_t ignored = 0;

  [[nodiscard]] bool fits(const ImageView& image) const {
    const std::size_t row_bytes =
        static_cast<std::size_t>(width) * static_cast<std::size_t>(samples_per_pixel) * (bits == 8 ? 1 : 2);
    return !image.empty() && image.width == width && image.height == height && image.format == format &&
           image.bits == bits && image.stride >= row_bytes && (bits == 8 || image.stride % 2 == 0);
  }

  template <typename T>
  void learn(const ImageView& image) {
    for (PixelStatistics& channel : channels)
      channel.add(static_cast<const T*>(image.data), image.stride / sizeof(T), full_scale,
                  static_cast<float>(config.saturated));
  }

  void solve() {
    const Target target{config.target_mean, config.target_sigma};
    for (PixelStatistics& channel : channels) {
      if (images < config.min_images)
        channel.solveWhole(target);
      else
        channel.solve(target, images);
    }
    solved_images = images;
  }

  template <typename T>
  void correctImage(const ImageView& image, std::uint8_t* out) const;
};

template <typename T>
void LightingModel::Impl::correctImage(const ImageView& image, std::uint8_t* out) const {
  constexpr int kBlock = 1536;  // samples worked on at a time: a multiple of 2 and 3
  float gain[kBlock], offset[kBlock];
  const int samples = width * samples_per_pixel;
  for (int y = 0; y < height; ++y) {
    const T* in =
        static_cast<const T*>(image.data) + static_cast<std::size_t>(y) * (image.stride / sizeof(T));
    std::uint8_t* line = out + static_cast<std::size_t>(y) * static_cast<std::size_t>(samples);
    for (int begin = 0; begin < samples; begin += kBlock) {
      const int n = std::min(kBlock, samples - begin);
      for (const PixelStatistics& statistics : channels) {
        const Channel& c = statistics.channel();
        if (y % c.row_step != c.row || n <= c.column) continue;
        statistics.corrections(y / c.row_step, begin / c.column_step, (n - c.column - 1) / c.column_step + 1,
                               gain + c.column, offset + c.column, c.column_step);
      }
      correctSamples(in + begin, gain, offset, 255.0F / full_scale, n, line + begin);
    }
  }
}

LightingModel::LightingModel(int width, int height, PixelFormat format, int bits,
                             const LightingConfig& config) {
  require(width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide,
          "image side must be 1 to 65535 px");
  require(format != PixelFormat::kBayerRggb || (width >= 2 && height >= 2),
          "a Bayer image has at least 2 x 2 pixels");
  require(bits == 8 || bits == 10 || bits == 12 || bits == 16, "bits must be 8, 10, 12 or 16");
  require(config.target_mean > 0 && config.target_mean < 1, "target_mean must lie between 0 and 1");
  require(config.target_sigma > 0 && config.target_sigma < 1, "target_sigma must lie between 0 and 1");
  require(config.min_images >= 1, "min_images must be at least 1");
  require(config.grid >= 1 && config.grid <= kMaxGrid, "grid must be 1 to 256 px");
  require(config.saturated > 0 && config.saturated <= 1, "saturated must lie between 0 and 1");
  impl_ = std::make_unique<Impl>(Impl{width,
                                      height,
                                      format,
                                      bits,
                                      config,
                                      format == PixelFormat::kRgb ? 3 : 1,
                                      static_cast<float>((1 << bits) - 1),
                                      {}});
  for (const Channel& channel : channelsOf(width, height, format))
    impl_->channels.emplace_back(channel, config.grid);
}

LightingModel::~LightingModel() = default;

int LightingModel::images() const {
  return impl_->images;
}

std::uint64_t LightingModel::ignoredImages() const {
  return impl_->ignored;
}

void LightingModel::add(const ImageView& image) {
  Impl& m = *impl_;
  if (!m.fits(image)) {
    ++m.ignored;
    return;
  }
  if (m.bits == 8)
    m.learn<std::uint8_t>(image);
  else
    m.learn<std::uint16_t>(image);
  ++m.images;
  if (m.images <= kSolveAlways || m.images - m.solved_images >= m.images / kSolveFraction) m.solve();
}

void LightingModel::correct(const ImageView& image, std::uint8_t* out) const {
  const Impl& m = *impl_;
  if (!m.fits(image)) {
    std::memset(out, 0,
                static_cast<std::size_t>(m.width) * static_cast<std::size_t>(m.height * m.samples_per_pixel));
    return;
  }
  if (m.bits == 8)
    m.correctImage<std::uint8_t>(image, out);
  else
    m.correctImage<std::uint16_t>(image, out);
}

}  // namespace fathom::lighting
