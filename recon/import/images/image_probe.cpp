#include "recon/import/images/image_probe.hpp"

#include <algorithm>
#include <bit>
#include <optional>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kProbed = 32;  // images of a camera

// What samples of 16 bits really have, by the brightest of some images: a converter's full scale where it was
// reached, else as much again as they show, for images that are brighter.
int bitsBy(int brightest) {
  constexpr int kLeast = 9, kMost = 16;
  const int bits = std::bit_width(static_cast<unsigned>(brightest));
  const bool full = brightest == (1 << bits) - 1;
  return std::clamp(full ? bits : bits + 1, kLeast, kMost);
}

}  // namespace

Probed probe(const std::filesystem::path& folder, const std::vector<std::string>& names, Samples samples,
             const char* option) {
  Probed out;
  std::optional<Mosaic> mosaic;
  const std::size_t step = std::max<std::size_t>(1, names.size() / kProbed);
  bool first = true;
  int brightest = -1;  // of more than 8 bits
  for (std::size_t k = 0; k < names.size(); k += step) {
    try {
      const io::ImageFile file = readSamples(folder / names[k], samples);
      const ImageView& view = file.view;
      if (view.bits > 8) brightest = std::max(brightest, brightestOf(view));
      if (first || view.format == PixelFormat::kRgb) out.format = view.format;
      if (first) out.size = {view.width, view.height};
      if (first && samples == Samples::kAuto && out.format == PixelFormat::kMono) mosaic = mosaicOf(view);
      first = false;
    } catch (const InputError&) {  // counted where it is used
    }
  }
  if (brightest >= 0) out.bits = bitsBy(brightest);
  if (mosaic && out.format == PixelFormat::kMono)
    throw InputError(
        folder / names.front(), "",
        formatted("looks like a Bayer mosaic (every other pixel differs by %.0f %%): give %s %s, or "
                  "another order, or mono if it is none",
                  100 * mosaic->contrast, option,
                  sampleNames()[static_cast<std::size_t>(mosaic->order)].c_str()));
  return out;
}

}  // namespace fathom::topside
