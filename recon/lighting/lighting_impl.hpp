#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "recon/lighting/channel_model.hpp"
#include "recon/lighting/colour_light.hpp"
#include "recon/lighting/demosaic.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/node_statistics.hpp"

namespace fathom::lighting {

// Chooses the model that predicts images best, by its errors on images that it has not learnt yet.
class ModelChoice {
 public:
  // One image's mean absolute errors, in logarithms; negative: not tried.
  void score(double whole, double plain, double range) {
    const std::array<double, kModels> now = {whole, plain, range};
    for (std::size_t k = 0; k < kModels; ++k) {
      if (now[k] < 0) continue;
      count_[k] = std::min(count_[k] + 1, kWindow);
      error_[k] += (now[k] - error_[k]) / count_[k];
    }
    if (count_[chosen_] < kFewest) return;
    std::size_t best = chosen_;
    for (std::size_t k = 0; k < kModels; ++k)
      if (count_[k] >= kFewest && error_[k] < error_[best]) best = k;
    if (error_[best] < kBetter * error_[chosen_]) chosen_ = best;
  }

  [[nodiscard]] LightingKind best() const {
    return static_cast<LightingKind>(chosen_ + static_cast<std::size_t>(LightingKind::kWholeImage));
  }
  [[nodiscard]] double error(LightingKind kind) const {
    const auto k = static_cast<std::size_t>(kind) - static_cast<std::size_t>(LightingKind::kWholeImage);
    return count_[k] > 0 ? error_[k] : -1;
  }

  // For saved state (state_archive.hpp), bit by bit.
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    std::uint64_t chosen = self.chosen_;
    archive(chosen, self.count_, self.error_);
    archive.require(chosen < kModels, "an unknown model");
    if constexpr (Archive::kLoading)
      if (archive.ok()) self.chosen_ = chosen;
  }

 private:
  static constexpr std::size_t kModels = 3;
  static constexpr double kWindow = 100;  // images in the mean error
  static constexpr double kFewest = 8;    // images before an error counts
  static constexpr double kBetter = 0.95;
  std::size_t chosen_ = 1;  // the plain one, until another is better
  std::array<double, kModels> count_{}, error_{};
};

enum class Purpose : std::uint8_t { kMatching, kColour };

// What an image is corrected for, and by what.
struct Task {
  Purpose purpose = Purpose::kMatching;
  const RangeLattice* range = nullptr;   // null: unknown
  float brightness = 1;                  // of the image's light over that of the learnt images
  const FallCorrection* fall = nullptr;  // of colours
  float texture = 1;                     // gain for matching (textureGain())
};

// A row of nodes' corrections, by channel.
inline constexpr std::size_t kMaxChannels = 4;
using NodeRow = std::array<std::array<Correction, NodeLattice::kMaxSide>, kMaxChannels>;

// What an image shows at each node: range [m], 0 unknown, and how its slope answers to the lamps.
struct NodeGround {
  std::vector<float> ranges, slopes;
};

// State of a LightingModel: lighting_impl.cpp learns, lighting_model.cpp corrects.
struct LightingModel::Impl {
  int width, height;
  PixelFormat format;
  int bits;
  LightingConfig config;
  int samples_per_pixel;
  NodeLattice lattice;
  RowPlan plan;
  std::vector<ChannelModel> channels;
  NodeGround nodes;                   // of an image being learnt
  std::vector<float> means;           // of it, by node
  std::optional<ColourLight> colour;  // always there
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
  // Light of an image with that exposure over that of the learnt images.
  [[nodiscard]] float brightness(double exposure_s) const {
    if (!(exposure_s > 0) || exposure == 0) return 1;
    constexpr double kMostBrighter = 64;  // than another exposure: no camera has a wider range of them
    return colour->samplesFor(std::clamp(exposure_s / exposure, 1 / kMostBrighter, kMostBrighter));
  }
  void add(const ImageView& image, const RangeLattice* range, double exposure_s);
  // Whether the strobes stayed dark: more than half of the image is far below the expected brightness.
  [[nodiscard]] bool unlit(const ImageView& image, float exposed, const NodeGround& at) const;
  template <typename T>
  [[nodiscard]] bool unlitOf(const ImageView& image, float exposed, const NodeGround& at) const;
  // `out` has an entry for each node. Null: unknown.
  void lookAt(const RangeLattice* range, NodeGround& out) const;
  template <typename T>
  void learn(const ImageView& image, const RangeLattice* range, float exposed);
  // Gives ColourLight the ratios of measured to expected node means.
  void learnRatios(std::size_t c, const RangeLattice* range);
  struct Errors {
    double sums[3] = {}, count[3] = {};  // whole, plain, range
  };
  void predict(const ChannelModel& channel, Errors& errors) const;
  [[nodiscard]] Correction stretch(const ChannelModel& channel, const Level& level, float brightness) const;
  // Whether samples are sRGB already, as in a camera's 8-bit RGB pictures.
  [[nodiscard]] bool encoded() const { return format == PixelFormat::kRgb && bits == 8; }
  void nodeRow(const Task& task, LightingKind kind, int j, NodeRow& row) const;
  // Gives a row of nodes that gain more, about the samples' mean in the neighbourhood of each.
  void pullApart(const ImageView& image, float gain, int j, NodeRow& row) const;
  template <typename T>
  void pullApartOf(const ImageView& image, float gain, int j, NodeRow& row) const;
  template <Encoding kEncoding, typename T>
  void correctImage(const Task& task, const ImageView& image, std::uint8_t* out) const;
  template <Encoding kEncoding>
  void correct(const Task& task, const ImageView& image, std::uint8_t* out) const;
  void grey(const Task& task, const ImageView& image, std::uint8_t* mosaic, std::uint8_t* rgb,
            std::uint8_t* grey) const;
  // Of what the ground's contrast is in each colour as it comes.
  [[nodiscard]] GreyShares greyShares() const;
  // Of the three colours, that which a channel has.
  [[nodiscard]] std::size_t colourOf(std::size_t channel) const {
    return format == PixelFormat::kBayerRggb ? (channel + 1) / 2 : channels.size() == 1 ? 1 : channel;
  }
  [[nodiscard]] const ChannelModel& channelOf(std::size_t of_colour) const {
    const std::size_t last = channels.size() - 1;  // of a Bayer image blue; of its two greens the first
    return channels[of_colour == 2 ? last : std::min(of_colour, last)];
  }
  static void exchange(auto& archive, auto& self);
};

}  // namespace fathom::lighting
