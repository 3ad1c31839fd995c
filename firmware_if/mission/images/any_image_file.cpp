#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "firmware_if/mission/images/image_pixels.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"

// Reads photographs of any camera, JPEG too. A translation unit of its own, because OpenCV's codecs bring a
// hundred megabytes of libraries, which the vehicle's program does not link: it reads its own images only.
namespace fathom::io {
namespace {

// Decodes an image whose header was checked. The orientation tag of a photograph is ignored: pixels stay in
// the sensor's rows and columns.
bool decodeByOpenCv(const std::vector<std::uint8_t>& bytes, TiffPixels& pixels, std::string& error) {
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) {
    error = "a damaged JPEG";
    return false;
  }
  if ((image.depth() != CV_8U && image.depth() != CV_16U) ||
      (image.channels() != 1 && image.channels() != 3)) {
    error = std::to_string(image.channels()) + " channels; only grey and RGB of 8 or 16 bit can be read";
    return false;
  }
  pixels.width = image.cols;
  pixels.height = image.rows;
  pixels.channels = image.channels();
  pixels.bits = image.depth() == CV_8U ? 8 : 16;
  const std::size_t sample_bytes = image.elemSize1();
  pixels.bytes.assign(image.datastart, image.dataend);
  if (pixels.channels == 3)  // OpenCV decodes to BGR
    for (std::size_t i = 0; i + 3 * sample_bytes <= pixels.bytes.size(); i += 3 * sample_bytes)
      std::swap_ranges(&pixels.bytes[i], &pixels.bytes[i] + sample_bytes,
                       &pixels.bytes[i + 2 * sample_bytes]);
  return true;
}

// Size in the frame header of a JPEG (ITU-T T.81, B.2.2); false where there is none, or no end of image after
// it: OpenCV fills what is missing of an image with grey and reports no error.
bool jpegSize(const std::vector<std::uint8_t>& bytes, std::size_t& width, std::size_t& height) {
  constexpr std::size_t kFrameHeaderBytes = 9;  // marker, length, precision, height, width
  const auto word = [&](std::size_t i) { return std::size_t{bigEndianAt<std::uint16_t>(bytes, i)}; };
  std::size_t at = 2;  // past the start of image
  while (at + kFrameHeaderBytes <= bytes.size() && bytes[at] == 0xff) {
    const std::uint8_t marker = bytes[at + 1];
    if (marker == 0xff) {  // a fill byte (B.1.1.2)
      ++at;
      continue;
    }
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
  return decodeByOpenCv(bytes, pixels, error);
}

}  // namespace

ImageFile readAnyImage(const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = readFileBytes(path, kMaxImageFileBytes, "an image");
  TiffPixels pixels;
  std::string error;
  if (!(isJpeg(bytes) ? decodeJpeg(bytes, pixels, error) : decodeTiffOrPng(bytes, pixels, error)))
    throw InputError(path, "", "cannot be read as an image (" + error + "); give a TIFF, PNG or JPEG");
  const int bits = usedBits(pixels);
  const PixelFormat format = pixels.channels == 3 ? PixelFormat::kRgb : PixelFormat::kMono;
  return imageFileOf(std::move(pixels), format, bits);
}

}  // namespace fathom::io
