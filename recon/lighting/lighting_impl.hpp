#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include "recon/lighting/channel_model.hpp"
#include "recon/lighting/colour_light.hpp"
#include "recon/lighting/correct_rows.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/model_choice.hpp"
#include "recon/lighting/node_lattice.hpp"

namespace fathom::lighting {

enum class Purpose : std::uint8_t { kMatching, kColour };

// A row of nodes' corrections, by channel.
inline constexpr std::size_t kMaxChannels = 4;
using NodeRow = std::array<std::array<Correction, NodeLattice::kMaxSide>, kMaxChannels>;

// LightingModel's own: what learns is in lighting_learning.cpp, what corrects in lighting_model.cpp.
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
    constexpr double kMostBrighter = 64;  // than another exposure: no camera has a wider range of them
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

}  // namespace fathom::lighting
