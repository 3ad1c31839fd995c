#include "recon/lighting/lighting_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

#include "realtime/base/bytes/state_archive.hpp"
#include "recon/lighting/lighting_impl.hpp"
#include "recon/lighting/texture_gain.hpp"

namespace fathom::lighting {
namespace {

constexpr int kMaxSide = 65535;      // [px]
constexpr float kMinSigma = 0.002F;  // floor of the signal's sigma, of full scale: half a level of 8 bits
// Floor of sigma over mean: in denser haze, gain would amplify noise alone.
constexpr float kMinContrast = 0.04F;
constexpr std::uint32_t kTag = rt::stateTag("LITE"), kVersion = 5;

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(std::string("lighting model: ") + what);
}

}  // namespace

const char* nameOf(LightingKind kind) {
  constexpr std::array<const char*, 4> kNames = {"none", "whole image", "plain", "range-dependent"};
  return kNames[static_cast<std::size_t>(kind)];
}

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

Correction LightingModel::Impl::stretch(const ChannelModel& channel, const Level& level,
                                        float brightness) const {
  const float usual = std::exp(level.log_mean), mean = channel.lit(usual, brightness);
  const float spread = std::max(std::exp(level.log_spread), kMinContrast);
  const float gain =
      static_cast<float>(config.target_sigma) / std::max(spread * brightness * usual, kMinSigma);
  const float full = static_cast<float>((1 << bits) - 1), grey = 255;
  return {grey * gain / full, grey * (static_cast<float>(config.target_mean) - gain * mean)};
}

void LightingModel::Impl::nodeRow(const Task& task, LightingKind kind, int j, NodeRow& row) const {
  for (int i = 0; i < lattice.columns; ++i) {
    const auto n = static_cast<std::size_t>(j * lattice.columns + i);
    const float range_m = task.range != nullptr ? task.range->at(lattice.u(i), lattice.v(j)) : 0;
    const bool by_range = kind == LightingKind::kRangeDependent && range_m > 0;
    const float position = by_range ? RangeBins::position(range_m) : 0;
    // Images for matching keep the shading of slopes, which is useful texture.
    const bool colours = task.purpose == Purpose::kColour;
    float slope = 1, depth_m = 0;
    if (by_range && colours) {
      const RangeLattice::Ground ground = task.range->groundAt(lattice.u(i), lattice.v(j));
      slope = colour->lit(ground), depth_m = ground.point.z();
    }
    for (std::size_t c = 0; c < channels.size(); ++c) {
      const ChannelModel& channel = channels[c];
      Correction& out = row[c][static_cast<std::size_t>(i)];
      const Level& plain = kind == LightingKind::kWholeImage ? channel.whole() : channel.plain(n);
      const Level level = by_range ? channel.atRange(n, position) : plain;
      if (!channel.known()) {
        out = {(colours && !encoded() ? 1.0F : 255.0F) / static_cast<float>((1 << bits) - 1), 0.0F};
      } else if (colours) {
        const double off = task.fall->at(colourOf(c), range_m, depth_m);
        const float fall = off != 0 ? colour->samplesFor(std::exp(off)) : 1;
        out = colour->correction(c, channel, level, task.brightness, slope, fall);
      } else {
        out = stretch(channel, level, task.brightness);
      }
    }
  }
}

template <Encoding kEncoding, typename T>
void LightingModel::Impl::correctImage(const Task& task, const ImageView& image, std::uint8_t* out) const {
  const LightingKind kind = used();
  NodeRow above, below, between;
  const auto load = [&](int j, NodeRow& row) {
    nodeRow(task, kind, j, row);
    if (task.texture != 1) pullApart(image, task.texture, j, row);
  };
  int loaded = -1;
  for (int y = 0; y < height; ++y) {
    const float t =
        (static_cast<float>(y) + 0.5F) * static_cast<float>(lattice.rows) / static_cast<float>(height) - 0.5F;
    const int j = std::clamp(static_cast<int>(std::floor(t)), 0, std::max(lattice.rows - 2, 0));
    if (j != loaded) {
      if (loaded >= 0 && j == loaded + 1)
        above = below;
      else
        load(j, above);
      load(std::min(j + 1, lattice.rows - 1), below);
      loaded = j;
    }
    const float share = t - static_cast<float>(j);  // of the row below
    const std::size_t first = format == PixelFormat::kBayerRggb ? static_cast<std::size_t>(y % 2) * 2 : 0;
    const std::size_t in_row = format == PixelFormat::kBayerRggb ? 2 : channels.size();
    for (std::size_t c = first; c < first + in_row; ++c)
      for (std::size_t i = 0; i < static_cast<std::size_t>(lattice.columns); ++i) {
        const Correction a = above[c][i], b = below[c][i];
        between[c][i] = {a.gain + share * (b.gain - a.gain), a.offset + share * (b.offset - a.offset)};
      }
    const T* in =
        static_cast<const T*>(image.data) + static_cast<std::size_t>(y) * (image.stride / sizeof(T));
    std::uint8_t* line =
        out + static_cast<std::size_t>(y) * static_cast<std::size_t>(width * samples_per_pixel);
    if (format == PixelFormat::kRgb)
      correctRgbRow<kEncoding>(plan, in, {between[0].data(), between[1].data(), between[2].data()}, line);
    else
      correctRow<kEncoding>(plan, in, between[first].data(), between[first + in_row - 1].data(), line);
  }
}

template <Encoding kEncoding>
void LightingModel::Impl::correct(const Task& task, const ImageView& image, std::uint8_t* out) const {
  if (!fits(image))
    std::memset(out, 0,
                static_cast<std::size_t>(width) * static_cast<std::size_t>(height * samples_per_pixel));
  else if (bits == 8)
    correctImage<kEncoding, std::uint8_t>(task, image, out);
  else
    correctImage<kEncoding, std::uint16_t>(task, image, out);
}

LightingModel::LightingModel(int width, int height, PixelFormat format, int bits,
                             const LightingConfig& config) {
  require(width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide,
          "image side must be 1 to 65535 px");
  require(format != PixelFormat::kBayerRggb || (width >= 2 && height >= 2),
          "a Bayer image has at least 2 x 2 pixels");
  require(bits >= 8 && bits <= 16, "bits must be 8 to 16");
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
  impl_->nodes.ranges.resize(lattice.size());
  impl_->means.resize(lattice.size());
  impl_->nodes.slopes.resize(lattice.size());
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

bool LightingModel::unlit(const ImageView& image, const RangeLattice& range, double exposure_s) const {
  if (!impl_->fits(image)) return false;
  NodeGround at{std::vector<float>(impl_->lattice.size()), std::vector<float>(impl_->lattice.size())};
  impl_->lookAt(&range, at);
  return impl_->unlit(image, impl_->brightness(exposure_s), at);
}

void LightingModel::add(const ImageView& image, const RangeLattice& range, double exposure_s) {
  impl_->add(image, &range, exposure_s);
}

void LightingModel::add(const ImageView& image) {
  impl_->add(image, nullptr, 0);
}

void LightingModel::correct(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
                            double exposure_s) const {
  impl_->correct<Encoding::kLevels>({.range = &range, .brightness = impl_->brightness(exposure_s)}, image,
                                    out);
}

void LightingModel::correctColour(const ImageView& image, const RangeLattice& range, std::uint8_t* out,
                                  const ImageLight& light) const {
  const Task task = {
      .purpose = Purpose::kColour,
      .range = &range,
      .brightness = impl_->brightness(light.exposure_s) * impl_->colour->samplesFor(light.gain),
      .fall = &light.fall};
  if (impl_->encoded())
    impl_->correct<Encoding::kLevels>(task, image, out);
  else
    impl_->correct<Encoding::kSrgb>(task, image, out);
}

void LightingModel::colours(const ImageView& image, const RangeLattice& range, std::uint8_t* mosaic,
                            std::uint8_t* rgb, const ImageLight& light) const {
  const Impl& m = *impl_;
  correctColour(image, range, mosaic, light);
  demosaicRgb(
      {mosaic, m.width, m.height, static_cast<std::size_t>(m.width * m.samples_per_pixel), m.format, 8}, rgb);
  if (m.fits(image)) neutraliseClipped(image, m.config.saturated, rgb);
}

GreyShares LightingModel::Impl::greyShares() const {
  if (format == PixelFormat::kRgb) return usualShares(format);
  std::array<double, 3> contrast{};  // parts of full scale
  for (std::size_t c = 0; c < 3; ++c) {
    const ChannelModel& channel = channelOf(c);
    if (!channel.known()) return usualShares(format);
    contrast[c] = static_cast<double>(std::exp(channel.whole().log_mean) * channel.contrast());
  }
  const double all = contrast[0] + contrast[1] + contrast[2];
  if (!(all > 0)) return usualShares(format);
  const auto share = [&](std::size_t c) {
    return static_cast<std::uint16_t>(std::lround(kWhole * contrast[c] / all));
  };
  GreyShares shares{share(0), 0, share(2)};
  shares[1] = static_cast<std::uint16_t>(kWhole - shares[0] - shares[2]);
  return shares;
}

void LightingModel::Impl::grey(const Task& task, const ImageView& image, std::uint8_t* mosaic,
                               std::uint8_t* rgb, std::uint8_t* grey) const {
  if (format == PixelFormat::kMono) {
    correct<Encoding::kLevels>(task, image, grey);
    return;
  }
  correct<Encoding::kLevels>(task, image, mosaic);
  greyOf({mosaic, width, height, static_cast<std::size_t>(width * samples_per_pixel), format, 8},
         greyShares(), rgb, grey);
}

void LightingModel::grey(const ImageView& image, const RangeLattice& range, std::uint8_t* mosaic,
                         std::uint8_t* rgb, std::uint8_t* grey, double exposure_s) const {
  Task task{.range = &range, .brightness = impl_->brightness(exposure_s)};
  impl_->grey(task, image, mosaic, rgb, grey);
  if (used() == LightingKind::kNone) return;
  task.texture = textureGain(grey, impl_->width, impl_->height);
  if (task.texture != 1) impl_->grey(task, image, mosaic, rgb, grey);
}

void LightingModel::correct(const ImageView& image, std::uint8_t* out) const {
  impl_->correct<Encoding::kLevels>({}, image, out);
}

double LightingModel::logFall(std::size_t colour, double range) const {
  if (used() != LightingKind::kRangeDependent) return 0;
  return static_cast<double>(RangeBins::between(impl_->channelOf(colour).trend(), static_cast<float>(range)));
}

double LightingModel::seen(int bin) const {
  return impl_->channels.front().seen(bin);
}

double LightingModel::usualRange() const {
  double sum = 0, images = 0;
  for (int b = 0; b < RangeBins::kKnown; ++b) {
    sum += seen(b) * std::log(RangeBins::middle(b));
    images += seen(b);
  }
  return images > 0 ? std::exp(sum / images) : 0;
}

FallCorrection LightingModel::correctionTo(const WaterLaw& water) const {
  FallCorrection out;
  if (used() != LightingKind::kRangeDependent || !(usualRange() > 0)) return out;
  out.usual = static_cast<float>(usualRange());
  for (std::size_t c = 0; c < water.colours.size(); ++c) {
    double mean = 0, images = 0;
    std::array<double, RangeBins::kKnown> off{};
    for (int b = 0; b < RangeBins::kKnown; ++b) {
      const double range = RangeBins::middle(b);
      off[index(b)] = water.colours[c].logAt(range) - logFall(c, range);
      mean += seen(b) * off[index(b)], images += seen(b);
    }
    mean /= images;
    for (std::size_t b = 0; b < off.size(); ++b)
      out.log_light[c][b] = static_cast<float>(water.share * (off[b] - mean));
  }
  return out;
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
  report.memory_bytes = sizeof(Impl) + 3 * m.means.capacity() * sizeof(float);
  report.tilt = static_cast<double>(m.colour->tilt().strength());
  report.lamp = m.colour->tilt().lamp();
  for (std::size_t c = 0; c < m.channels.size(); ++c)
    report.black =
        std::max(report.black, static_cast<double>(std::max(m.colour->pedestal(c), m.channels[c].black())));
  std::uint64_t saturated = 0;
  for (const ChannelModel& channel : m.channels) {
    report.outlier_share += channel.statistics().outlierShare() / static_cast<double>(m.channels.size());
    saturated += channel.statistics().saturatedSamples();
    report.memory_bytes += channel.memoryBytes();
  }
  if (m.samples > 0) report.saturated_share = static_cast<double>(saturated) / static_cast<double>(m.samples);
  for (std::size_t colour = 0; colour < 3; ++colour) {
    const ChannelModel& channel = m.channelOf(colour);
    if (channel.knowsRange()) report.attenuation[colour] = {channel.law().power, channel.law().per_metre};
  }
  return report;
}

void LightingModel::Impl::exchange(auto& archive, auto& self) {
  archive(self.images, self.solved_images, self.held, self.exposure, self.ignored, self.samples, self.choice,
          *self.colour);
  for (auto& channel : self.channels) archive(channel);
  archive.require(self.solved_images >= 0 && self.solved_images <= self.images,
                  "more images solved than added");
  archive.require(self.held >= 0 && self.held <= self.images && self.exposure >= 0, "more held than learnt");
}

void LightingModel::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { Impl::exchange(writer, std::as_const(*impl_)); });
}

bool LightingModel::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { Impl::exchange(reader, *impl_); });
}

}  // namespace fathom::lighting
