#include "firmware_if/mission/images/image_pixels.hpp"

#include <png.h>
#include <tiffio.h>

#include <algorithm>
#include <bit>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <utility>

namespace fathom::io {
namespace {

// A file in memory for libtiff: either the bytes to read or the vector that grows.
struct MemoryFile {
  std::span<const std::uint8_t> in;
  std::vector<std::uint8_t>* out = nullptr;
  std::uint64_t position = 0;
  std::string error;  // the first message

  [[nodiscard]] std::uint64_t size() const { return out != nullptr ? out->size() : in.size(); }
};

MemoryFile& memory(thandle_t handle) {
  return *static_cast<MemoryFile*>(handle);
}

tmsize_t readProc(thandle_t handle, void* buffer, tmsize_t count) {
  MemoryFile& file = memory(handle);
  const std::uint8_t* source = file.out != nullptr ? file.out->data() : file.in.data();
  if (file.position >= file.size() || count <= 0) return 0;
  const std::uint64_t n =
      std::min<std::uint64_t>(static_cast<std::uint64_t>(count), file.size() - file.position);
  std::memcpy(buffer, source + file.position, n);
  file.position += n;
  return static_cast<tmsize_t>(n);
}

tmsize_t writeProc(thandle_t handle, void* buffer, tmsize_t count) {
  MemoryFile& file = memory(handle);
  if (file.out == nullptr || count <= 0) return 0;
  const std::uint64_t end = file.position + static_cast<std::uint64_t>(count);
  if (end > file.out->size()) file.out->resize(end);
  std::memcpy(file.out->data() + file.position, buffer, static_cast<std::size_t>(count));
  file.position = end;
  return count;
}

toff_t seekProc(thandle_t handle, toff_t offset, int whence) {
  MemoryFile& file = memory(handle);
  if (whence == SEEK_SET) file.position = offset;
  if (whence == SEEK_CUR) file.position += offset;
  if (whence == SEEK_END) file.position = file.size() + offset;
  return file.position;
}

int closeProc(thandle_t) {
  return 0;
}
toff_t sizeProc(thandle_t handle) {
  return memory(handle).size();
}

int keepError(TIFF*, void* user, const char*, const char* format, va_list arguments) {
  std::string& error = static_cast<MemoryFile*>(user)->error;
  if (error.empty()) {
    char line[160];
    std::vsnprintf(line, sizeof line, format, arguments);
    error = line;
  }
  return 1;
}
int ignoreWarning(TIFF*, void*, const char*, const char*, va_list) {
  return 1;
}

// A single allocation that a hostile header asks for stays below this.
constexpr tmsize_t kMaxAllocation = tmsize_t{1} << 30;  // [bytes]

using TiffPtr = std::unique_ptr<TIFF, decltype(&TIFFClose)>;

TiffPtr open(MemoryFile& file, const char* mode) {
  const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(TIFFOpenOptionsAlloc(),
                                                                                 &TIFFOpenOptionsFree);
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kMaxAllocation);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &keepError, &file);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), &ignoreWarning, nullptr);
  return {TIFFClientOpenExt("memory", mode, &file, readProc, writeProc, seekProc, closeProc, sizeProc,
                            nullptr, nullptr, options.get()),
          &TIFFClose};
}

bool readHeader(TIFF* tiff, TiffPixels& pixels, std::string& error) {
  std::uint32_t width = 0, height = 0;
  std::uint16_t channels = 1, bits = 1, format = SAMPLEFORMAT_UINT, photometric = 0,
                planar = PLANARCONFIG_CONTIG;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &channels);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &planar);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &photometric);
  const std::uint16_t wanted = channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB;
  if (width == 0 || height == 0 || width > kMaxTiffPixels || height > kMaxTiffPixels / width)
    error = "size " + std::to_string(width) + " x " + std::to_string(height) + " cannot be";
  else if ((channels != 1 && channels != 3) || photometric != wanted || planar != PLANARCONFIG_CONTIG)
    error = std::to_string(channels) + " channels of photometric kind " + std::to_string(photometric) +
            "; grey (black is zero) or RGB is read";
  else if ((bits != 8 && bits != 16) || format != SAMPLEFORMAT_UINT)
    error = std::to_string(bits) + " bit samples of format " + std::to_string(format) +
            "; unsigned 8 or 16 bit are read";
  else if (TIFFIsTiled(tiff) != 0)
    error = "tiles; an image in strips is read";
  if (!error.empty()) return false;
  pixels.width = static_cast<int>(width);
  pixels.height = static_cast<int>(height);
  pixels.channels = channels;
  pixels.bits = bits;
  return true;
}

// Whole strips where they are of moderate size: libtiff then inflates them in one go (libdeflate), three
// times as fast as row by row.
bool readStrips(TIFF* tiff, std::size_t row_bytes, TiffPixels& pixels, std::string& error,
                const MemoryFile& file) {
  constexpr std::size_t kMaxStrip = std::size_t{16} << 20;  // [bytes]
  std::uint32_t strip_rows = 0;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &strip_rows);
  const auto height = static_cast<std::uint32_t>(pixels.height);
  const std::uint32_t at_once = std::clamp<std::uint32_t>(strip_rows, 1, height);
  const bool whole = at_once * row_bytes <= kMaxStrip;
  const std::uint32_t step = whole ? at_once : 1;
  // Grown as rows arrive: a truncated file that claims a huge size costs no more than it holds.
  for (std::uint32_t row = 0; row < height; row += step) {
    const std::size_t offset = row * row_bytes, bytes = std::min(step, height - row) * row_bytes;
    pixels.bytes.resize(offset + bytes);
    std::uint8_t* to = pixels.bytes.data() + offset;
    const bool read = whole ? TIFFReadEncodedStrip(tiff, row / step, to, static_cast<tmsize_t>(bytes)) ==
                                  static_cast<tmsize_t>(bytes)
                            : TIFFReadScanline(tiff, to, row, 0) == 1;
    if (!read) {
      error = "row " + std::to_string(row) + " of " + std::to_string(pixels.height) + ": " + file.error;
      return false;
    }
  }
  return true;
}

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

bool decodeTiff(std::span<const std::uint8_t> bytes, TiffPixels& pixels, std::string& error) {
  error.clear();
  MemoryFile file;
  file.in = bytes;
  const TiffPtr tiff = open(file, "r");
  if (!tiff) {
    error = "no TIFF: " + file.error;
    return false;
  }
  if (!readHeader(tiff.get(), pixels, error)) return false;
  const std::size_t row_bytes = static_cast<std::size_t>(pixels.width) *
                                static_cast<std::size_t>(pixels.channels) *
                                static_cast<std::size_t>(pixels.bits / 8);
  if (TIFFScanlineSize64(tiff.get()) != row_bytes) {
    error = "rows of " + std::to_string(TIFFScanlineSize64(tiff.get())) + " bytes, not " +
            std::to_string(row_bytes);
    return false;
  }
  pixels.bytes.clear();
  return readStrips(tiff.get(), row_bytes, pixels, error, file);
}

std::vector<std::uint8_t> encodeTiff(const void* rows, std::size_t stride, int width, int height,
                                     int channels, int bits) {
  std::vector<std::uint8_t> bytes;
  MemoryFile file;
  file.out = &bytes;
  {
    const TiffPtr tiff = open(file, "w");
    if (!tiff) throw std::runtime_error("TIFF cannot be written: " + file.error);
    // The quickest deflate: sensor noise hardly compresses further, and a vehicle writes as it flies.
    constexpr int kDeflateLevel = 1;
    constexpr int kRowsPerStrip = 64;
    TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(width));
    TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(height));
    TIFFSetField(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, channels);
    TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tiff.get(), TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
    TIFFSetField(tiff.get(), TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC, channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB);
    TIFFSetField(tiff.get(), TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
    TIFFSetField(tiff.get(), TIFFTAG_PREDICTOR, PREDICTOR_HORIZONTAL);
    TIFFSetField(tiff.get(), TIFFTAG_ZIPQUALITY, kDeflateLevel);
    TIFFSetField(tiff.get(), TIFFTAG_ROWSPERSTRIP, kRowsPerStrip);
    // libtiff's predictor works in place, so it gets a copy of each row.
    const std::size_t row_bytes = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels) *
                                  static_cast<std::size_t>(bits / 8);
    std::vector<std::uint8_t> row_copy(row_bytes);
    for (int row = 0; row < height; ++row) {
      std::memcpy(row_copy.data(),
                  static_cast<const std::uint8_t*>(rows) + static_cast<std::size_t>(row) * stride, row_bytes);
      if (TIFFWriteScanline(tiff.get(), row_copy.data(), static_cast<std::uint32_t>(row), 0) != 1)
        throw std::runtime_error("TIFF cannot be written: " + file.error);
    }
  }
  return bytes;
}

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
