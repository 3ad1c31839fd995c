#include "recon/lighting/lighting_impl.hpp"

namespace fathom::lighting {
namespace {

constexpr int kSolveAlways = 32;    // images up to which every image is followed by a solution
constexpr int kSolveFraction = 16;  // later, one in this share of the images so far

}  // namespace

void LightingModel::Impl::predict(const ChannelModel& channel, Errors& errors) const {
  constexpr int kPatch = 4;       // nodes a side: smaller structure is the seafloor's
  constexpr double kWorst = 1.0;  // most that an error counts: a fish can fill a patch
  for (int pj = 0; pj < lattice.rows; pj += kPatch)
    for (int pi = 0; pi < lattice.columns; pi += kPatch) {
      double sums[3] = {}, count = 0, count_range = 0;
      for (int j = pj; j < std::min(pj + kPatch, lattice.rows); ++j)
        for (int i = pi; i < std::min(pi + kPatch, lattice.columns); ++i) {
          const auto n = static_cast<std::size_t>(j * lattice.columns + i);
          if (means[n] <= 0) continue;
          const double measured = std::log(static_cast<double>(means[n]));
          count += 1;
          sums[0] += measured - static_cast<double>(channel.whole().log_mean);
          sums[1] += measured - static_cast<double>(channel.plain(n).log_mean);
          if (!(nodes.ranges[n] > 0) || !channel.knowsRange()) continue;
          count_range += 1;
          sums[2] += measured -
                     static_cast<double>(channel.atRange(n, RangeBins::position(nodes.ranges[n])).log_mean);
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
bool LightingModel::Impl::unlitOf(const ImageView& image, float exposed, const NodeGround& at) const {
  constexpr float kUnlit = 0.15F;  // of the expected brightness
  const ChannelModel& channel = channels.front();
  if (!channel.known()) return false;
  const bool plain = solved_images >= config.min_images;  // serves where ranges are not known
  const float full = static_cast<float>((1 << bits) - 1),
              black = std::max(colour->pedestal(0), channel.black());
  std::size_t dark = 0;
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      const auto n = static_cast<std::size_t>(j * lattice.columns + i);
      // A sample of the first channel: of a mosaic, at even rows and columns.
      const auto x = static_cast<std::size_t>(lattice.u(i) * static_cast<float>(width)) / 2 * 2,
                 y = static_cast<std::size_t>(lattice.v(j) * static_cast<float>(height)) / 2 * 2;
      const T* line = static_cast<const T*>(image.data) + y * (image.stride / sizeof(T));
      const float measured =
          static_cast<float>(line[x * static_cast<std::size_t>(format == PixelFormat::kRgb ? 3 : 1)]);
      const bool ranged = at.ranges[n] > 0 && channel.knowsRange();
      if (!ranged && !plain) continue;
      const Level level = ranged ? channel.atRange(n, RangeBins::position(at.ranges[n])) : channel.plain(n);
      const float expected = channel.lit(std::exp(level.log_mean), exposed * at.slopes[n]);
      dark += measured / full - black < kUnlit * (expected - black);
    }
  return 2 * dark > lattice.size();
}

bool LightingModel::Impl::unlit(const ImageView& image, float exposed, const NodeGround& at) const {
  return bits == 8 ? unlitOf<std::uint8_t>(image, exposed, at) : unlitOf<std::uint16_t>(image, exposed, at);
}

template <typename T>
void LightingModel::Impl::pullApartOf(const ImageView& image, float gain, int j, NodeRow& row) const {
  constexpr int kCells = 3, kStep = 3;  // side of a neighbourhood; every third sample tells its mean
  const float middle = 255 * static_cast<float>(config.target_mean);
  const auto part = [](int cell, int cells, int sites_there) {
    return std::array<int, 2>{std::max(cell - kCells / 2, 0) * sites_there / cells,
                              std::min(cell + kCells / 2 + 1, cells) * sites_there / cells};
  };
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const Channel& sites = channels[c].statistics().channel();
    const auto [top, bottom] = part(j, lattice.rows, sites.height);
    for (int i = 0; i < lattice.columns; ++i) {
      const auto [left, right] = part(i, lattice.columns, sites.width);
      float sum = 0, count = 0;
      for (int y = top; y < bottom; y += kStep) {
        const T* line =
            static_cast<const T*>(image.data) +
            static_cast<std::size_t>(sites.row + y * sites.row_step) * (image.stride / sizeof(T)) +
            sites.column;
        for (int x = left; x < right; x += kStep, ++count)
          sum += static_cast<float>(line[x * sites.column_step]);
      }
      Correction& at = row[c][static_cast<std::size_t>(i)];
      at.gain *= gain;
      at.offset = middle - at.gain * sum / std::max(count, 1.0F);
    }
  }
}

void LightingModel::Impl::pullApart(const ImageView& image, float gain, int j, NodeRow& row) const {
  if (bits == 8)
    pullApartOf<std::uint8_t>(image, gain, j, row);
  else
    pullApartOf<std::uint16_t>(image, gain, j, row);
}

void LightingModel::Impl::lookAt(const RangeLattice* range, NodeGround& out) const {
  for (int j = 0; j < lattice.rows; ++j)
    for (int i = 0; i < lattice.columns; ++i) {
      const auto n = static_cast<std::size_t>(j * lattice.columns + i);
      out.ranges[n] = range == nullptr ? 0.0F : range->at(lattice.u(i), lattice.v(j));
      out.slopes[n] = out.ranges[n] > 0 ? colour->lit(range->groundAt(lattice.u(i), lattice.v(j))) : 1;
    }
}

template <typename T>
void LightingModel::Impl::learn(const ImageView& image, const RangeLattice* range, float exposed) {
  Errors errors;
  for (std::size_t c = 0; c < channels.size(); ++c) {
    ChannelModel& channel = channels[c];
    channel.statistics().add<T>(image, static_cast<float>(config.saturated), exposed, nodes.slopes,
                                nodes.ranges, means);
    if (solved_images < config.min_images || !channel.known()) continue;
    predict(channel, errors);
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
      const bool ranged = nodes.ranges[n] > 0 && channel.knowsRange();
      const Level level =
          ranged ? channel.atRange(n, RangeBins::position(nodes.ranges[n])) : channel.plain(n);
      const float expected = std::exp(level.log_mean);
      RangeLattice::Ground ground;
      if (ranged) ground = range->groundAt(lattice.u(i), lattice.v(j));
      colour->learn(c, channel.lit(expected, nodes.slopes[n]), means[n] / expected,
                    ranged ? &ground : nullptr);
    }
}

void LightingModel::Impl::add(const ImageView& image, const RangeLattice* range, double exposure_s) {
  if (!fits(image)) {
    ++ignored;
    return;
  }
  if (exposure == 0 && exposure_s > 0 && std::isfinite(exposure_s)) exposure = exposure_s;
  lookAt(range, nodes);
  const float exposed = brightness(exposure_s);
  if (unlit(image, exposed, nodes)) {
    ++ignored;
    return;
  }
  if (bits == 8)
    learn<std::uint8_t>(image, range, exposed);
  else
    learn<std::uint16_t>(image, range, exposed);
  ++images;
  ++held;
  if (config.memory > 0 && held >= 2 * config.memory) {
    for (ChannelModel& channel : channels) channel.statistics().halve();
    colour->halve();
    held /= 2;
  }
  samples += lattice.size() * channels.size() * NodeStatistics::kSamplesPerImage;
  if (held > kSolveAlways && images - solved_images < held / kSolveFraction) return;
  for (ChannelModel& channel : channels) channel.solve(held, config.outlier, !encoded());
  float contrast = 0;
  for (const ChannelModel& channel : channels)
    contrast += channel.contrast() / static_cast<float>(channels.size());
  colour->solve(contrast);
  solved_images = images;
}

}  // namespace fathom::lighting
