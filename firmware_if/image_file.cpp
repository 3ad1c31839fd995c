#include "firmware_if/image_file.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "firmware_if/civil_time.hpp"
#include "firmware_if/file_bytes.hpp"
#include "firmware_if/tiff_codec.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{1} << 28;
constexpr std::int64_t kNanosecondsPerMillisecond = 1'000'000;

int channelsOf(PixelFormat format) {
  return format == PixelFormat::kRgb ? 3 : 1;
}

// "0123" -> 123; -1 when a character is no digit.
int digits(const std::string& text, std::size_t first, std::size_t count) {
  int value = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    if (text[i] < '0' || text[i] > '9') return -1;
    value = 10 * value + (text[i] - '0');
  }
  return value;
}

constexpr std::uint8_t kPngSignature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

bool isPng(const std::vector<std::uint8_t>& bytes) {
  return bytes.size() >= sizeof kPngSignature && std::equal(kPngSignature, kPngSignature + 8, bytes.begin());
}

// The pixels of an image whose header has been checked. A photograph's note on how it was held is not
// followed: rows and columns are the sensor's.
bool decodeByOpenCv(const std::vector<std::uint8_t>& bytes, const char* kind, TiffPixels& pixels,
                    std::string& error) {
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) {
    error = std::string("a damaged ") + kind;
    return false;
  }
  if ((image.depth() != CV_8U && image.depth() != CV_16U) ||
      (image.channels() != 1 && image.channels() != 3)) {
    error = std::to_string(image.channels()) + " channels; grey or RGB of 8 or 16 bit is read";
    return false;
  }
  pixels.width = image.cols;
  pixels.height = image.rows;
  pixels.channels = image.channels();
  pixels.bits = image.depth() == CV_8U ? 8 : 16;
  const std::size_t sample_bytes = image.elemSize1();
  pixels.bytes.assign(image.datastart, image.dataend);
  if (pixels.channels == 3)  // OpenCV gives blue first
    for (std::size_t i = 0; i + 3 * sample_bytes <= pixels.bytes.size(); i += 3 * sample_bytes)
      std::swap_ranges(&pixels.bytes[i], &pixels.bytes[i] + sample_bytes,
                       &pixels.bytes[i + 2 * sample_bytes]);
  return true;
}

// PNG through OpenCV. Its header is checked first, so that a damaged one never makes OpenCV ask for much
// memory.
bool decodePng(const std::vector<std::uint8_t>& bytes, TiffPixels& pixels, std::string& error) {
  constexpr std::size_t kHeaderBytes = 33;  // signature and the IHDR chunk
  constexpr std::size_t kWidthOffset = 16, kHeightOffset = 20;
  const auto bigEndian = [&](std::size_t at) {
    return std::size_t{bytes[at]} << 24 | std::size_t{bytes[at + 1]} << 16 | std::size_t{bytes[at + 2]} << 8 |
           std::size_t{bytes[at + 3]};
  };
  if (bytes.size() < kHeaderBytes) {
    error = "a PNG without its header";
    return false;
  }
  const std::size_t width = bigEndian(kWidthOffset), height = bigEndian(kHeightOffset);
  if (width == 0 || height == 0 || width > kMaxTiffPixels || height > kMaxTiffPixels / width) {
    error = "size " + std::to_string(width) + " x " + std::to_string(height) + " cannot be";
    return false;
  }
  return decodeByOpenCv(bytes, "PNG", pixels, error);
}

// Size in the frame header of a JPEG (ITU-T T.81, B.2.2); false where there is none, or no end of image after
// it: OpenCV would fill what is missing with grey.
bool jpegSize(const std::vector<std::uint8_t>& bytes, std::size_t& width, std::size_t& height) {
  constexpr std::size_t kFrameHeaderBytes = 9;  // marker, length, precision, height, width
  const auto word = [&](std::size_t i) { return std::size_t{bytes[i]} << 8 | std::size_t{bytes[i + 1]}; };
  std::size_t at = 2;  // past the start of image
  while (at + kFrameHeaderBytes <= bytes.size() && bytes[at] == 0xff) {
    const std::uint8_t marker = bytes[at + 1];
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame) {
      height = word(at + 5);
      width = word(at + 7);
      constexpr std::uint8_t kEndOfImage[2] = {0xff, 0xd9};
      return std::search(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.end(), kEndOfImage,
                         kEndOfImage + 2) != bytes.end();
    }
    at += 2 + std::max<std::size_t>(word(at + 2), 2);
  }
  return false;
}

bool isJpeg(const std::vector<std::uint8_t>& bytes) {
  return bytes.size() >= 4 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff;
}

bool decodeJpeg(const std::vector<std::uint8_t>& bytes, TiffPixels& pixels, std::string& error) {
  std::size_t width = 0, height = 0;
  if (!jpegSize(bytes, width, height) || width == 0 || height == 0 || width > kMaxTiffPixels / height) {
    error = "a JPEG without a usable size, or cut short";
    return false;
  }
  return decodeByOpenCv(bytes, "JPEG", pixels, error);
}

bool decodeImage(const std::vector<std::uint8_t>& bytes, TiffPixels& pixels, std::string& error) {
  if (isPng(bytes)) return decodePng(bytes, pixels, error);
  return decodeTiff(bytes, pixels, error);
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

ImageFile fileOf(TiffPixels&& pixels, PixelFormat format, int bits) {
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

}  // namespace

std::string imageFileName(std::int64_t utc_ns, CameraSide side) {
  const CivilTime t = civilFromUtc(utc_ns);
  char name[80];
  std::snprintf(name, sizeof name, "PR_%04d%02d%02d_%02d%02d%02d_%03d_%s16.tif", t.year, t.month, t.day,
                t.hour, t.minute, t.second, static_cast<int>(t.nanosecond / kNanosecondsPerMillisecond),
                side == CameraSide::kLeft ? "LC" : "RM");
  return name;
}

std::optional<ImageName> parseImageFileName(const std::string& name) {
  static const std::string kForm = "PR_dddddddd_dddddd_ddd_xx16.tif";
  if (name.size() != kForm.size()) return std::nullopt;
  for (std::size_t i = 0; i < name.size(); ++i)
    if (kForm[i] != 'd' && kForm[i] != 'x' && kForm[i] != name[i]) return std::nullopt;
  ImageName result;
  const std::string side = name.substr(23, 2);
  if (side == "RM")
    result.side = CameraSide::kRight;
  else if (side != "LC")
    return std::nullopt;
  const int milliseconds = digits(name, 19, 3);
  if (milliseconds < 0) return std::nullopt;
  const auto utc = utcFromCivil({digits(name, 3, 4), digits(name, 7, 2), digits(name, 9, 2),
                                 digits(name, 12, 2), digits(name, 14, 2), digits(name, 16, 2),
                                 static_cast<int>(milliseconds * kNanosecondsPerMillisecond)});
  if (!utc) return std::nullopt;
  result.utc_ns = *utc;
  return result;
}

bool plainFileName(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name.find('/') == std::string::npos &&
         name.find('\0') == std::string::npos;
}

ImageFile readImage(const std::filesystem::path& path, PixelFormat format, int bits, int width, int height) {
  const std::vector<std::uint8_t> bytes = readFileBytes(path, kMaxFileBytes, "an image");
  TiffPixels pixels;
  std::string error;
  if (!decodeImage(bytes, pixels, error))
    throw InputError(path, "",
                     "is damaged or of another kind (" + error + "); give a whole TIFF or leave it out");
  if (pixels.channels != channelsOf(format))
    throw InputError(path, "",
                     "has " + std::to_string(pixels.channels) + " channels where the mission says " +
                         std::to_string(channelsOf(format)));
  const int sample_bits = bits == 8 ? 8 : 16;
  if (pixels.bits != sample_bits)
    throw InputError(path, "",
                     "has " + std::to_string(pixels.bits) + " bit samples where the mission says " +
                         std::to_string(bits) + " bit pixels");
  if ((width != 0 && pixels.width != width) || (height != 0 && pixels.height != height))
    throw InputError(path, "",
                     "is " + std::to_string(pixels.width) + " x " + std::to_string(pixels.height) +
                         " where the calibration says " + std::to_string(width) + " x " +
                         std::to_string(height));
  if (sample_bits == 16 && bits < 16 && largestSample(pixels) >> bits != 0)
    throw InputError(path, "",
                     "has a sample of " + std::to_string(largestSample(pixels)) + ", more than " +
                         std::to_string(bits) + " bits; correct cameras.bits of mission.toml");
  return fileOf(std::move(pixels), format, bits);
}

ImageFile readAnyImage(const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = readFileBytes(path, kMaxFileBytes, "an image");
  TiffPixels pixels;
  std::string error;
  if (!(isJpeg(bytes) ? decodeJpeg(bytes, pixels, error) : decodeImage(bytes, pixels, error)))
    throw InputError(path, "", "is no image that can be read (" + error + "); give a TIFF, PNG or JPEG");
  int bits = pixels.bits;
  if (bits == 16)
    for (const int fewer : {12, 10})
      if (largestSample(pixels) >> fewer == 0) bits = fewer;
  const PixelFormat format = pixels.channels == 3 ? PixelFormat::kRgb : PixelFormat::kMono;
  return fileOf(std::move(pixels), format, bits);
}

void writeImage(const std::filesystem::path& path, const ImageView& image) {
  if (image.empty())
    throw std::invalid_argument("an image without pixels cannot be written: " + path.string());
  const std::vector<std::uint8_t> bytes = encodeTiff(image.data, image.stride, image.width, image.height,
                                                     channelsOf(image.format), image.bits == 8 ? 8 : 16);
  AtomicFile file(path);
  file.stream().write(reinterpret_cast<const char*>(bytes.data()),
                      static_cast<std::streamsize>(bytes.size()));
  file.commit();
}

}  // namespace fathom::io
