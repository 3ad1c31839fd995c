#include "recon/products/tiles/picture_codec.hpp"

#include <turbojpeg.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "realtime/base/input_error.hpp"

namespace fathom::topside {
namespace {

// One for each picture: a decompressor keeps the tables of what it read before, damaged ones too.
struct TurboHandle {
  explicit TurboHandle(tjhandle opened) : handle(opened) {
    if (handle == nullptr) throw std::runtime_error("libjpeg-turbo cannot start");
  }
  ~TurboHandle() { tjDestroy(handle); }
  TurboHandle(const TurboHandle&) = delete;
  TurboHandle& operator=(const TurboHandle&) = delete;
  tjhandle handle;
};

std::vector<std::uint8_t> encodeJpeg(const RgbImage& image, const PictureConfig& config) {
  const TurboHandle turbo(tjInitCompress());
  const int sampling = config.half_chroma ? TJSAMP_420 : TJSAMP_444;
  std::vector<std::uint8_t> out(tjBufSize(image.width, image.height, sampling));
  unsigned char* place = out.data();
  unsigned long size = out.size();
  if (tjCompress2(turbo.handle, image.rgb.data(), image.width, 0, image.height, TJPF_RGB, &place, &size,
                  sampling, config.quality, TJFLAG_NOREALLOC) != 0)
    throw std::runtime_error(std::string("libjpeg-turbo: ") + tjGetErrorStr2(turbo.handle));
  out.resize(size);
  return out;
}

RgbImage decodeJpeg(std::span<const std::uint8_t> bytes, const std::string& name, int max_edge) {
  const TurboHandle turbo(tjInitDecompress());
  int width = 0, height = 0, sampling = 0, space = 0;
  if (tjDecompressHeader3(turbo.handle, bytes.data(), bytes.size(), &width, &height, &sampling, &space) != 0)
    throw InputError(name, "JPEG header", std::string("is damaged: ") + tjGetErrorStr2(turbo.handle));
  if (width <= 0 || height <= 0 || width > max_edge || height > max_edge)
    throw InputError(name, "JPEG header", "names a size that no tile has");
  RgbImage image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  // Damaged data is a warning to the library; here it is an error.
  if (tjDecompress2(turbo.handle, bytes.data(), bytes.size(), image.rgb.data(), width, 0, height, TJPF_RGB,
                    TJFLAG_STOPONWARNING) != 0)
    throw InputError(name, "JPEG data", std::string("is damaged: ") + tjGetErrorStr2(turbo.handle));
  return image;
}

std::vector<std::uint8_t> encodeWebp(const RgbImage& image, const PictureConfig& wanted) {
  WebPConfig config;
  if (WebPConfigPreset(&config, WEBP_PRESET_PHOTO, static_cast<float>(wanted.quality)) == 0)
    throw std::runtime_error("libwebp: another version than it was built for");
  config.method = std::clamp(wanted.webp_effort, 0, 6);
  WebPPicture picture;
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  const std::unique_ptr<WebPMemoryWriter, void (*)(WebPMemoryWriter*)> clear_writer(&writer,
                                                                                    WebPMemoryWriterClear);
  if (WebPPictureInit(&picture) == 0) throw std::runtime_error("libwebp: cannot start");
  picture.width = image.width;
  picture.height = image.height;
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  const std::unique_ptr<WebPPicture, void (*)(WebPPicture*)> clear_picture(&picture, WebPPictureFree);
  if (WebPPictureImportRGB(&picture, image.rgb.data(), 3 * image.width) == 0 ||
      WebPEncode(&config, &picture) == 0)
    throw std::runtime_error("libwebp: error " + std::to_string(picture.error_code));
  return {writer.mem, writer.mem + writer.size};
}

RgbImage decodeWebp(std::span<const std::uint8_t> bytes, const std::string& name, int max_edge) {
  int width = 0, height = 0;
  if (WebPGetInfo(bytes.data(), bytes.size(), &width, &height) == 0)
    throw InputError(name, "WebP header", "is damaged");
  if (width <= 0 || height <= 0 || width > max_edge || height > max_edge)
    throw InputError(name, "WebP header", "names a size that no tile has");
  RgbImage image{width, height, {}};
  image.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  if (WebPDecodeRGBInto(bytes.data(), bytes.size(), image.rgb.data(), image.rgb.size(), 3 * width) == nullptr)
    throw InputError(name, "WebP data", "is damaged");
  return image;
}

bool startsWith(std::span<const std::uint8_t> bytes, std::size_t at, std::string_view text) {
  return bytes.size() >= at + text.size() &&
         std::equal(text.begin(), text.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

}  // namespace

std::vector<std::uint8_t> encodePicture(const RgbImage& image, const PictureConfig& config) {
  const auto samples = 3 * static_cast<std::size_t>(std::max(image.width, 0)) *
                       static_cast<std::size_t>(std::max(image.height, 0));
  if (image.empty() || image.rgb.size() != samples) throw std::invalid_argument("a picture without pixels");
  if (config.quality < 1 || config.quality > 100) throw std::invalid_argument("a quality outside 1 to 100");
  switch (config.format) {
    case PictureFormat::kJpeg:
      return encodeJpeg(image, config);
    case PictureFormat::kWebp:
      return encodeWebp(image, config);
    case PictureFormat::kNone:
      break;
  }
  throw std::invalid_argument("a picture of no format");
}

PictureFormat formatOf(std::span<const std::uint8_t> bytes) {
  if (startsWith(bytes, 0, "\xFF\xD8\xFF")) return PictureFormat::kJpeg;
  if (startsWith(bytes, 0, "RIFF") && startsWith(bytes, 8, "WEBP")) return PictureFormat::kWebp;
  return PictureFormat::kNone;
}

RgbImage decodePicture(std::span<const std::uint8_t> bytes, const std::string& name, int max_edge) {
  switch (formatOf(bytes)) {
    case PictureFormat::kJpeg:
      return decodeJpeg(bytes, name, max_edge);
    case PictureFormat::kWebp:
      return decodeWebp(bytes, name, max_edge);
    case PictureFormat::kNone:
      break;
  }
  throw InputError(name, "picture", "is neither JPEG nor WebP");
}

double psnr(const RgbImage& image, const RgbImage& reference) {
  if (image.width != reference.width || image.height != reference.height ||
      image.rgb.size() != reference.rgb.size())
    throw std::invalid_argument("psnr of images of different sizes");
  std::uint64_t sum = 0;
  for (std::size_t k = 0; k < image.rgb.size(); ++k) {
    const int difference = image.rgb[k] - reference.rgb[k];
    sum += static_cast<std::uint64_t>(difference * difference);
  }
  if (sum == 0) return std::numeric_limits<double>::infinity();
  return 10 * std::log10(255.0 * 255.0 * static_cast<double>(image.rgb.size()) / static_cast<double>(sum));
}

}  // namespace fathom::topside
