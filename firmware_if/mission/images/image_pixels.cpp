#include "firmware_if/mission/images/image_pixels.hpp"

#include <png.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

namespace fathom::io {
namespace {

constexpr std::uint8_t kPngSignature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

bool isPng(std::span<const std::uint8_t> bytes) {
  return bytes.size() >= sizeof kPngSignature && std::equal(kPngSignature, kPngSignature + 8, bytes.begin());
}

struct PngInput {
  std::span<const std::uint8_t> left;
  std::string* error = nullptr;
};

void readPng(png_structp png, png_bytep to, std::size_t count) {
  auto* input = static_cast<PngInput*>(png_get_io_ptr(png));
  if (count > input->left.size()) png_error(png, "cut short");
  std::memcpy(to, input->left.data(), count);
  input->left = input->left.subspan(count);
}

[[noreturn]] void onPngError(png_structp png, png_const_charp what) {
  *static_cast<PngInput*>(png_get_error_ptr(png))->error = std::string("a damaged PNG: ") + what;
  png_longjmp(png, 1);
}

void onPngWarning(png_structp, png_const_charp) {}

// libpng jumps back to setjmp() on errors: only objects of the caller may own memory here.
bool decodeWith(png_structp png, png_infop info, PngInput& input, TiffPixels& pixels,
                std::vector<png_bytep>& rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_read_fn(png, &input, readPng);
  png_set_user_limits(png, static_cast<png_uint_32>(kMaxTiffPixels),
                      static_cast<png_uint_32>(kMaxTiffPixels));
  png_read_info(png, info);
  const std::size_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
  if (width == 0 || height == 0 || width > kMaxTiffPixels || height > kMaxTiffPixels / width) {
    *input.error = "size " + std::to_string(width) + " x " + std::to_string(height) + " cannot be";
    return false;
  }
  png_set_expand(png);  // palettes to colours, few bits to eight
  if constexpr (std::endian::native == std::endian::little) png_set_swap(png);
  (void)png_set_interlace_handling(png);
  png_read_update_info(png, info);
  const int channels = png_get_channels(png, info);
  if (channels != 1 && channels != 3) {
    *input.error = std::to_string(channels) + " channels; grey or RGB of 8 or 16 bit is read";
    return false;
  }
  pixels.width = static_cast<int>(width);
  pixels.height = static_cast<int>(height);
  pixels.channels = channels;
  pixels.bits = png_get_bit_depth(png, info);
  const std::size_t row = png_get_rowbytes(png, info);
  pixels.bytes.resize(row * height);
  rows.resize(height);
  for (std::size_t y = 0; y < height; ++y) rows[y] = pixels.bytes.data() + y * row;
  png_read_image(png, rows.data());
  png_read_end(png, nullptr);
  return true;
}

}  // namespace

bool decodePng(std::span<const std::uint8_t> file, TiffPixels& pixels, std::string& error) {
  PngInput input{file, &error};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &input, onPngError, onPngWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  std::vector<png_bytep> rows;
  const bool decoded = info != nullptr && decodeWith(png, info, input, pixels, rows);
  png_destroy_read_struct(&png, &info, nullptr);
  if (!decoded && error.empty()) error = "a PNG that cannot be read";
  return decoded;
}

bool decodeTiffOrPng(std::span<const std::uint8_t> file, TiffPixels& pixels, std::string& error) {
  return isPng(file) ? decodePng(file, pixels, error) : decodeTiff(file, pixels, error);
}

std::uint16_t largestSample(const TiffPixels& pixels) {
  std::uint16_t largest = 0;
  for (std::size_t i = 0; i + 1 < pixels.bytes.size(); i += 2) {
    std::uint16_t sample;
    std::memcpy(&sample, &pixels.bytes[i], sizeof sample);
    largest = std::max(largest, sample);
  }
  return largest;
}

int usedBits(const TiffPixels& pixels) {
  if (pixels.bits == 8) return 8;
  const std::uint16_t largest = largestSample(pixels);
  return largest >> 10 == 0 ? 10 : largest >> 12 == 0 ? 12 : 16;
}

ImageFile imageFileOf(TiffPixels&& pixels, PixelFormat format, int bits) {
  ImageFile image;
  image.bytes = std::move(pixels.bytes);
  image.view.data = image.bytes.data();
  image.view.width = pixels.width;
  image.view.height = pixels.height;
  image.view.stride = static_cast<std::size_t>(pixels.width) * static_cast<std::size_t>(pixels.channels) *
                      static_cast<std::size_t>(bits == 8 ? 1 : 2);
  image.view.format = format;
  image.view.bits = bits;
  return image;
}

}  // namespace fathom::io
