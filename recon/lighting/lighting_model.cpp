#include "recon/lighting/lighting_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "realtime/kernel/state_archive.hpp"
#include "recon/lighting/channel_model.hpp"
#include "recon/lighting/colour_light.hpp"
#include "recon/lighting/correct_rows.hpp"
#include "recon/lighting/model_choice.hpp"
#include "recon/lighting/node_lattice.hpp"

namespace fathom::lighting {
namespace {

constexpr int kMaxSide = 65535;        // [px]
constexpr int kSolveAlways = 32;       // images up to which every image is followed by a solution
constexpr int kSolveFraction = 16;     // later, one in this share of the images so far
constexpr float kMinSigma = 0.002F;    // of full scale: half a level of 8 bits; less is quantisation
constexpr float kMinContrast = 0.04F;  // sigma of mean: in thicker haze, gain would show noise alone
constexpr std::size_t kMaxChannels = 4;
constexpr std::uint32_t kTag = rt::stateTag("LITE"), kVersion = 4;
constexpr double kMostBrighter = 64;  // than another exposure: no camera's range of exposures is wider

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("lighting model: ") + what);
}

enum class Purpose : std::uint8_t { kMatching, kColour };

// A row of nodes' corrections, by channel.
using NodeRow = std::array<std::array<Correction, NodeLattice::kMaxSide>, kMaxChannels>;

}  // namespace

const char* nameOf(LightingKind kind) {
  constexpr std::array<const char*, 4> kNames = {"none", "whole image", "plain", "range-dependent"};
  return kNames[static_cast<std::size_t>(kind)];
}

struct LightingModel::Impl {
  int width, height;
  PixelFormat format;
  int bits;
  LightingConfig config;
  int samples_per_pixel;
  NodeLattice lattice;
  RowPlan plan;
  std::vector<ChannelModel> channels;
  std::vector<float> ranges, brightnesses, means;  // of an image being learnt, by node
  std::optional<ColourLight> colour;               // always there
  ModelChoice choice;
  int images = 0, solved_images = 0;
  int held = 0;         // images that what was learnt weighs
  double exposure = 0;  // that statistics are brought to [s]; 0: none known
  std::uint64_t ignored = 0, samples = 0;

  [[nodiscard]] bool fits(const ImageView& image) const {
    const std::size_t row_bytes =
        static_cast<std::size_t>(width) * static_cast<std::size_t>(samples_per_pixel) * (bits == 8 ? 1 : 2);
    return !image.empty() && image.width == width && image.height == height && image.format == format &&
           image.bits == bits && image.stride >= row_bytes && (bits == 8 || image.stride % 2 == 0);
  }
  [[nodiscard]] LightingKind used() const;
  // Of an image of that exposure, against what is learnt.
  [[nodiscard]] float brightness(double exposure_s) const {
    if (!(exposure_s > 0) || exposure == 0) return 1;
    return colour->samplesFor(std::clamp(exposure_s / exposure, 1 / kMostBrighter, kMostBrighter));
  }
  void add(const ImageView& image, const RangeLattice* range, double exposure_s);
  // Strobes that stayed dark tell nothing of how they light: most of the image is far below what is expected.
  template <typename T>
  [[nodiscard]] bool unlit(const ImageView& image) const;
  template <typename T>
  void learn(const ImageView& image, const RangeLattice* range);
  // What nodes showed beside what was expected of them.
  void learnRatios(std::size_t c, const RangeLattice* range);
  struct Errors {
    double sums[3] = {}, count[3] = {};  // whole, plain, range
  };
  void foretell(const ChannelModel& channel, Errors& errors) const;
  [[nodiscard]] Correction stretch(const Level& level, float brightness) const;
  // Of samples that are sRGB already, as cameras write pictures for people.
  [[nodiscard]] bool encoded() const { return format == PixelFormat::kRgb && bits == 8; }
  void nodeRow(Purpose purpose, LightingKind kind, const RangeLattice* range, float brightness, int j,
               NodeRow& row) const;
  template <Encoding kEncoding, typename T>
  void correctImage(Purpose purpose, const ImageView& image, const RangeLattice* range, float brightness,
                    std::uint8_t* out) const;
  template <Encoding kEncoding>
  void correct(Purpose purpose, const ImageView& image, const RangeLattice* range, float brightness,
               std::uint8_t* out) const;
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
};

LightingKind LightingModel::Impl::used() const {
  const auto known = [](const ChannelModel& c) { return c.known(); };
  if (std::none_of(channels.begin(), channels.end(), known)) return LightingKind::kNone;
  if (solved_images < config.min_images) return LightingKind::kWholeImage;
  LightingKind kind = choice.best();
  if (config.choice != LightingChoice::kAuto) kind = static_cast<LightingKind>(config.choice);
  const auto ranged = [](const ChannelModel& c) { return c.knowsRange(); };
  if (kind == LightingKind::kRangeDependent && !std::all_of(channels.begin(), channels.end(), ranged))
    return LightingKind::kPlain;
  return kind;
}

void LightingModel::Impl::foretell(const ChannelModel& channel, Errors& errors) const {
  constexpr int kPatch = 4;       // nodes a side: what is smaller is taken for the seafloor's
  constexpr double kWorst = 1.0;  // an error counts no more: a fish fills a patch, too
  for (int pj = 0; pj < lattice.rows; pj += kPatch)
    for (int pi = 0; pi < lattice.columns; pi += kPatch) {
      double sums[3] = {}, count = 0, count_range = 0;
      for (int j = pj; j < std::min(pj + kPatch, lattice.rows); ++j)
        for (int i = pi; i < std::min(pi + kPatch, lattice.columns); ++i) {
          const auto n = static_cast<std::size_t>(j * lattice.columns + i);
          if (means[n] <= 0) continue;
          const double seen = std::log(static_cast<double>(means[n]));
          count += 1;
          sums[0] += seen - static_cast<double>(channel.whole().log_mean);
          sums[1] += seen - static_cast<double>(channel.plain(n).log_mean);
          if (!(ranges[n] > 0) || !channel.knowsRange()) continue;
          count_range += 1;
          sums[2] += seen - static_cast<double>(channel.atRange(n, RangeBins::position(ranges[n])).log_mean);
        }
      for (std::size_t k = 0; k < 3; ++k) {
        const double in = k == 2 ? count_range : count;
        if (in == 0) continue;
        errors.sums[k] += std::min(std::abs(sums[k]) / in, kWorst);
        errors.count[k] += 1;
      }
    }
}

template <typename T>
bool LightingModel::Impl::unlit(const ImageView& image) const {
  constexpr float kUnlit = 0.15F;  // of what is expected
  const ChannelModel& channel = channels.front();
  if (!channel.known()) return false;
  const bool plain = solved_images >= config.min_images;  // tells enough where ranges are not known
  const float full = static_cast<float>((1 << bits) - 1), black = colour->pedestal(0);
  std::size_t dark = 0;
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      const auto n = static_cast<std::size_t>(j * lattice.columns + i);
      // A sample of the first channel: of a mosaic, at even rows and columns.
      const auto x = static_cast<std::size_t>(lattice.u(i)) / 2 * 2,
                 y = static_cast<std::size_t>(lattice.v(j)) / 2 * 2;
      const T* line = static_cast<const T*>(image.data) + y * (image.stride / sizeof(T));
      const float seen =
          static_cast<float>(line[x * static_cast<std::size_t>(format == PixelFormat::kRgb ? 3 : 1)]);
      const bool ranged = ranges[n] > 0 && channel.knowsRange();
      if (!ranged && !plain) continue;
      const Level level = ranged ? channel.atRange(n, RangeBins::position(ranges[n])) : channel.plain(n);
      dark += seen / full - black < kUnlit * (brightnesses[n] * std::exp(level.log_mean) - black);
    }
  return 2 * dark > lattice.size();
}

template <typename T>
void LightingModel::Impl::learn(const ImageView& image, const RangeLattice* range) {
  Errors errors;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    ChannelModel& channel = channels[c];
    channel.statistics().add(static_cast<const T*>(image.data), image.stride / sizeof(T), bits,
                             static_cast<float>(config.saturated), brightnesses, ranges, means);
    if (solved_images < config.min_images || !channel.known()) continue;
    foretell(channel, errors);
    learnRatios(c, range);
  }
  const auto mean = [&](int k) { return errors.count[k] > 0 ? errors.sums[k] / errors.count[k] : -1.0; };
  choice.score(mean(0), mean(1), mean(2));
}

void LightingModel::Impl::learnRatios(std::size_t c, const RangeLattice* range) {
  const ChannelModel& channel = channels[c];
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      const auto n = static_cast<std::size_t>(j * lattice.columns + i);
      if (means[n] <= 0) continue;
      const bool ranged = ranges[n] > 0 && channel.knowsRange();
      const Level level = ranged ? channel.atRange(n, RangeBins::position(ranges[n])) : channel.plain(n);
      const float expected = std::exp(level.log_mean);
      RangeLattice::Ground ground;
      if (ranged) ground = range->groundAt(lattice.u(i), lattice.v(j));
      colour->learn(c, expected * brightnesses[n], means[n] / expected, ranged ? &ground : nullptr);
    }
}

void LightingModel::Impl::add(const ImageView& image, const RangeLattice* range, double exposure_s) {
  if (!fits(image)) {
    ++ignored;
    return;
  }
  if (exposure == 0 && exposure_s > 0 && std::isfinite(exposure_s)) exposure = exposure_s;
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      const auto n = static_cast<std::size_t>(j * lattice.columns + i);
      ranges[n] = range == nullptr ? 0.0F : range->at(lattice.u(i), lattice.v(j));
      brightnesses[n] = brightness(exposure_s);
      if (ranges[n] > 0) brightnesses[n] *= colour->lit(range->groundAt(lattice.u(i), lattice.v(j)));
    }
  if (bits == 8 ? unlit<std::uint8_t>(image) : unlit<std::uint16_t>(image)) {
    ++ignored;
    return;
  }
  if (bits == 8)
    learn<std::uint8_t>(image, range);
  else
    learn<std::uint16_t>(image, range);
  ++images;
  ++held;
  if (config.memory > 0 && held >= 2 * config.memory) {
    for (ChannelModel& channel : channels) channel.statistics().halve();
    colour->halve();
    held /= 2;
  }
  samples += lattice.size() * channels.size() * NodeStatistics::kSamplesPerImage;
  if (held > kSolveAlways && images - solved_images < held / kSolveFraction) return;
  for (ChannelModel& channel : channels) channel.solve(held, config.outlier);
  float contrast = 0;
  for (const ChannelModel& channel : channels)
    contrast += channel.contrast() / static_cast<float>(channels.size());
  colour->solve(contrast);
  solved_images = images;
}

Correction LightingModel::Impl::stretch(const Level& level, float brightness) const {
  const float mean = brightness * std::exp(level.log_mean);
  const float spread = std::max(std::exp(level.log_spread), kMinContrast);
  const float gain = static_cast<float>(config.target_sigma) / std::max(spread * mean, kMinSigma);
  const float full = static_cast<float>((1 << bits) - 1), grey = 255;
  return {grey * gain / full, grey * (static_cast<float>(config.target_mean) - gain * mean)};
}

void LightingModel::Impl::nodeRow(Purpose purpose, LightingKind kind, const RangeLattice* range,
                                  float brightness, int j, NodeRow& row) const {
  for (int i = 0; i < lattice.columns; ++i) {
    const auto n = static_cast<std::size_t>(j * lattice.columns + i);
    float path = 0;
    if (kind == LightingKind::kRangeDependent && range != nullptr)
      path = range->at(lattice.u(i), lattice.v(j));
    const float position = path > 0 ? RangeBins::position(path) : 0;
    // What is matched keeps its slopes' shading, which is texture, too.
    const float lit = path > 0 && purpose == Purpose::kColour
                          ? colour->lit(range->groundAt(lattice.u(i), lattice.v(j)))
                          : 1;
    for (std::size_t c = 0; c < channels.size(); ++c) {
      const ChannelModel& channel = channels[c];
      Correction& out = row[c][static_cast<std::size_t>(i)];
      const bool linear = purpose == Purpose::kColour && !encoded();
      const Level& plain = kind == LightingKind::kWholeImage ? channel.whole() : channel.plain(n);
      const Level level = path > 0 ? channel.atRange(n, position) : plain;
      if (!channel.known())
        out = {(linear ? 1.0F : 255.0F) / static_cast<float>((1 << bits) - 1), 0.0F};
      else
        out = purpose == Purpose::kColour ? colour->correction(c, level, lit * brightness)
                                          : stretch(level, brightness);
    }
  }
}

template <Encoding kEncoding, typename T>
void LightingModel::Impl::correctImage(Purpose purpose, const ImageView& image, const RangeLattice* range,
                                       float brightness, std::uint8_t* out) const {
  const LightingKind kind = used();
  NodeRow above, below, here;
  int loaded = -1;
  for (int y = 0; y < height; ++y) {
    const float t =
        (static_cast<float>(y) + 0.5F) * static_cast<float>(lattice.rows) / static_cast<float>(height) - 0.5F;
    const int j = std::clamp(static_cast<int>(std::floor(t)), 0, std::max(lattice.rows - 2, 0));
    if (j != loaded) {
      if (loaded >= 0 && j == loaded + 1)
        above = below;
      else
        nodeRow(purpose, kind, range, brightness, j, above);
      nodeRow(purpose, kind, range, brightness, std::min(j + 1, lattice.rows - 1), below);
      loaded = j;
    }
    const float down = t - static_cast<float>(j);
    const std::size_t first = format == PixelFormat::kBayerRggb ? static_cast<std::size_t>(y % 2) * 2 : 0;
    const std::size_t in_row = format == PixelFormat::kBayerRggb ? 2 : channels.size();
    for (std::size_t c = first; c < first + in_row; ++c)
      for (std::size_t i = 0; i < static_cast<std::size_t>(lattice.columns); ++i) {
        const Correction a = above[c][i], b = below[c][i];
        here[c][i] = {a.gain + down * (b.gain - a.gain), a.offset + down * (b.offset - a.offset)};
      }
    const T* in =
        static_cast<const T*>(image.data) + static_cast<std::size_t>(y) * (image.stride / sizeof(T));
    std::uint8_t* line =
        out + static_cast<std::size_t>(y) * static_cast<std::size_t>(width * samples_per_pixel);
    if (format == PixelFormat::kRgb)
      correctRgbRow<kEncoding>(plan, in, {here[0].data(), here[1].data(), here[2].data()}, line);
    else
      correctRow<kEncoding>(plan, in, here[first].data(), here[first + in_row - 1].data(), line);
  }
}

template <Encoding kEncoding>
void LightingModel::Impl::correct(Purpose purpose, const ImageView& image, const RangeLattice* range,
                                  float brightness, std::uint8_t* out) const {
  if (!fits(image))
    std::memset(out, 0,
                static_cast<std::size_t>(width) * static_cast<std::size_t>(height * samples_per_pixel));
  else if (bits == 8)
    correctImage<kEncoding, std::uint8_t>(purpose, image, range, brightness, out);
  else
    correctImage<kEncoding, std::uint16_t>(purpose, image, range, brightness, out);
}

LightingModel::LightingModel(int width, int height, PixelFormat format, int bits,
                             const LightingConfig& config) {
  require(width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide,
          "image side must be 1 to 65535 px");
  require(format != PixelFormat::kBayerRggb || (width >= 2 && height >= 2),
          "a Bayer image has at least 2 x 2 pixels");
  require(bits == 8 || bits == 10 || bits == 12 || bits == 16, "bits must be 8, 10, 12 or 16");
  validate(config);
  const NodeLattice lattice(width, height, config.grid);
  impl_ = std::make_unique<Impl>();
  impl_->width = width;
  impl_->height = height;
  impl_->format = format;
  impl_->bits = bits;
  impl_->config = config;
  impl_->samples_per_pixel = format == PixelFormat::kRgb ? 3 : 1;
  impl_->lattice = lattice;
  impl_->plan = RowPlan(width, lattice.columns);
  impl_->ranges.resize(lattice.size());
  impl_->means.resize(lattice.size());
  impl_->brightnesses.resize(lattice.size());
  for (const Channel& channel : channelsOf(width, height, format))
    impl_->channels.emplace_back(channel, lattice);
  impl_->colour.emplace(impl_->channels.size(), impl_->encoded(), bits, config.target_mean);
}

LightingModel::~LightingModel() = default;

int LightingModel::images() const {
  return impl_->images;
}

std::uint64_t LightingModel::ignoredImages() const {
  return impl_->ignored;
}

void LightingModel::add(const ImageView& image, const RangeLattice& range, double exposure_s) {
  impl_->add(image, &range, exposure_s);
}

void LightingModel::add(const ImageView& image) {
  impl_->add(image, nullptr, 0);
}

void LightingModel::correct(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
                            double exposure_s) const {
  impl_->correct<Encoding::kLevels>(Purpose::kMatching, image, &range, impl_->brightness(exposure_s), out);
}

void LightingModel::correctColour(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
                                  double exposure_s, double gain) const {
  const float brightness = impl_->brightness(exposure_s) * impl_->colour->samplesFor(gain);
  if (impl_->encoded())
    impl_->correct<Encoding::kLevels>(Purpose::kColour, image, &range, brightness, out);
  else
    impl_->correct<Encoding::kSrgb>(Purpose::kColour, image, &range, brightness, out);
}

void LightingModel::colours(const ImageView& image, const RangeLattice& range, std::uint8_t* mosaic,
                            std::uint8_t* rgb, double exposure_s, double gain) const {
  const Impl& m = *impl_;
  correctColour(image, range, mosaic, exposure_s, gain);
  demosaicRgb(
      {mosaic, m.width, m.height, static_cast<std::size_t>(m.width * m.samples_per_pixel), m.format, 8}, rgb);
  if (m.fits(image)) greyWhereClipped(image, m.config.saturated, rgb);
}

void LightingModel::correct(const ImageView& image, std::uint8_t* out) const {
  impl_->correct<Encoding::kLevels>(Purpose::kMatching, image, nullptr, 1, out);
}

LightingKind LightingModel::used() const {
  return impl_->used();
}

LightingModel::Report LightingModel::report() const {
  const Impl& m = *impl_;
  Report report;
  report.used = m.used();
  report.images = m.images;
  report.error_whole = m.choice.error(LightingKind::kWholeImage);
  report.error_plain = m.choice.error(LightingKind::kPlain);
  report.error_range = m.choice.error(LightingKind::kRangeDependent);
  report.memory_bytes = sizeof(Impl) + 3 * m.ranges.capacity() * sizeof(float);
  report.tilt = static_cast<double>(m.colour->tilt().strength());
  report.lamp = m.colour->tilt().lamp();
  for (std::size_t c = 0; c < m.channels.size(); ++c)
    report.black = std::max(report.black, static_cast<double>(m.colour->pedestal(c)));
  std::uint64_t saturated = 0;
  for (const ChannelModel& channel : m.channels) {
    report.outlier_share += channel.statistics().outlierShare() / static_cast<double>(m.channels.size());
    saturated += channel.statistics().saturatedSamples();
    report.memory_bytes += channel.memoryBytes();
  }
  if (m.samples > 0) report.saturated_share = static_cast<double>(saturated) / static_cast<double>(m.samples);
  // A Bayer image's blue is its last channel; of its two greens the first speaks.
  const std::size_t last = m.channels.size() - 1;
  for (std::size_t colour = 0; colour < 3; ++colour) {
    const ChannelModel& channel = m.channels[colour == 2 ? last : std::min(colour, last)];
    if (channel.knowsRange()) report.attenuation[colour] = {channel.law().power, channel.law().per_metre};
  }
  return report;
}

template <typename Archive, typename Self>
void LightingModel::Impl::exchange(Archive& archive, Self& self) {
  archive(self.images, self.solved_images, self.held, self.exposure, self.ignored, self.samples, self.choice,
          *self.colour);
  for (auto& channel : self.channels) archive(channel);
  archive.require(self.solved_images >= 0 && self.solved_images <= self.images, "more learnt than seen");
  archive.require(self.held >= 0 && self.held <= self.images && self.exposure >= 0, "more held than learnt");
}

void LightingModel::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { Impl::exchange(writer, std::as_const(*impl_)); });
}

bool LightingModel::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { Impl::exchange(reader, *impl_); });
}

}  // namespace fathom::lighting
