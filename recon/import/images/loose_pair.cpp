#include "recon/import/images/loose_pair.hpp"

#include <string>

#include "realtime/base/input_error.hpp"
#include "recon/lighting/lighting_model.hpp"

namespace fathom::topside {
namespace {

// The whole image's mean and spread, as a mission's model has them before it has seen several images.
std::vector<std::uint8_t> stretched(const ImageView& image) {
  lighting::LightingModel model(image.width, image.height, image.format, image.bits, {});
  model.add(image);
  const std::size_t channels = image.format == PixelFormat::kRgb ? 3 : 1;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(image.width) *
                                static_cast<std::size_t>(image.height) * channels);
  model.correct(image, out.data());
  return out;
}

}  // namespace

ImageView LooseImage::monoView() const {
  return {mono.data(), width, height, static_cast<std::size_t>(width), PixelFormat::kMono, 8};
}

ImageView LooseImage::rgbView() const {
  return {rgb.data(), width, height, static_cast<std::size_t>(width) * 3, PixelFormat::kRgb, 8};
}

LooseImage readLooseImage(const std::filesystem::path& path, Samples samples, const Camera& camera) {
  const io::ImageFile file = readSamples(path, samples);
  requireSize(file, camera, path);
  LooseImage image{file.view.width, file.view.height, file.view.format, file.view.bits, {}, {}};
  ImageView view = file.view;
  std::vector<std::uint8_t> eight_bit;
  if (view.bits != 8) {
    eight_bit = stretched(view);
    const std::size_t channels = view.format == PixelFormat::kRgb ? 3 : 1;
    view.data = eight_bit.data();
    view.bits = 8;
    view.stride = static_cast<std::size_t>(view.width) * channels;
  }
  const std::size_t pixels = static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height);
  image.mono.resize(pixels);
  image.rgb.resize(pixels * 3);
  lighting::demosaicMono(view, image.mono.data());
  lighting::demosaicRgb(view, image.rgb.data());
  return image;
}

}  // namespace fathom::topside
