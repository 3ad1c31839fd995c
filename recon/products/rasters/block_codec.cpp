#include "recon/products/rasters/block_codec.hpp"

#include <libdeflate.h>
#include <webp/encode.h>

#include <bit>
#include <stdexcept>

namespace fathom::topside {
namespace {

constexpr int kDeflateLevel = 4;  // the last that is fast: level 6 takes twice the time for 3 % less
constexpr int kWebpMethod = 1;    // of 0 to 6: 4, the default, takes three times as long for 5 % less

struct Picture {
  WebPPicture webp;
  Picture() {
    if (WebPPictureInit(&webp) == 0) throw std::runtime_error("this libwebp is another version's");
  }
  ~Picture() { WebPPictureFree(&webp); }
  Picture(const Picture&) = delete;
  Picture& operator=(const Picture&) = delete;
};

int append(const std::uint8_t* data, std::size_t size, const WebPPicture* picture) {
  auto* out = static_cast<std::vector<std::uint8_t>*>(picture->custom_ptr);
  out->insert(out->end(), data, data + size);
  return 1;
}

}  // namespace

BlockCodec::BlockCodec(int edge)
    : edge_(static_cast<std::size_t>(edge)), compressor_(libdeflate_alloc_compressor(kDeflateLevel)) {
  if (compressor_ == nullptr) throw std::bad_alloc();
}
BlockCodec::~BlockCodec() {
  libdeflate_free_compressor(compressor_);
}

std::vector<std::uint8_t> BlockCodec::deflated(const std::vector<std::uint8_t>& raw) {
  std::vector<std::uint8_t> out(libdeflate_zlib_compress_bound(compressor_, raw.size()));
  const std::size_t size =
      libdeflate_zlib_compress(compressor_, raw.data(), raw.size(), out.data(), out.size());
  if (size == 0) throw std::runtime_error("a block of a raster does not deflate");
  out.resize(size);
  return out;
}

std::vector<std::uint8_t> BlockCodec::floats(const std::vector<float>& block) {
  constexpr std::size_t kBytes = sizeof(float);
  std::vector<std::uint8_t> raw(kBytes * block.size());
  for (std::size_t row = 0; row < edge_; ++row) {
    std::uint8_t* to = &raw[row * edge_ * kBytes];
    for (std::size_t x = 0; x < edge_; ++x) {
      const auto bits = std::bit_cast<std::uint32_t>(block[row * edge_ + x]);
      for (std::size_t k = 0; k < kBytes; ++k)  // planes, the highest byte's first
        to[k * edge_ + x] = static_cast<std::uint8_t>(bits >> (8 * (kBytes - 1 - k)));
    }
    for (std::size_t k = kBytes * edge_ - 1; k > 0; --k) to[k] = static_cast<std::uint8_t>(to[k] - to[k - 1]);
  }
  return deflated(raw);
}

std::vector<std::uint8_t> BlockCodec::coloursDeflated(const std::vector<std::uint8_t>& rgba) {
  std::vector<std::uint8_t> raw = rgba;
  for (std::size_t row = 0; row < edge_; ++row) {
    std::uint8_t* to = &raw[row * edge_ * 4];
    for (std::size_t k = 4 * edge_ - 1; k >= 4; --k) to[k] = static_cast<std::uint8_t>(to[k] - to[k - 4]);
  }
  return deflated(raw);
}

std::vector<std::uint8_t> BlockCodec::coloursWebp(const std::vector<std::uint8_t>& rgba, int quality) const {
  WebPConfig config;
  if (WebPConfigPreset(&config, WEBP_PRESET_DEFAULT, static_cast<float>(quality)) == 0)
    throw std::runtime_error("WebP quality must be between 0 and 100");
  config.method = kWebpMethod;
  std::vector<std::uint8_t> out;
  Picture picture;
  const int edge = static_cast<int>(edge_);
  picture.webp.width = picture.webp.height = edge;
  picture.webp.writer = append;
  picture.webp.custom_ptr = &out;
  if (WebPPictureImportRGBA(&picture.webp, rgba.data(), 4 * edge) == 0 ||
      WebPEncode(&config, &picture.webp) == 0)
    throw std::runtime_error("a block of the orthomosaic cannot be encoded as WebP");
  return out;
}

}  // namespace fathom::topside
