#include "firmware_if/mission/images/image_file.hpp"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <utility>

#include "firmware_if/mission/images/image_pixels.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

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

}  // namespace

FileName imageFileName(std::int64_t utc_ns, CameraSide side) {
  const CivilTime t = civilFromUtc(utc_ns);
  char name[80];
  std::snprintf(name, sizeof name, "PR_%04d%02d%02d_%02d%02d%02d_%03d_%s16.tif", t.year, t.month, t.day,
                t.hour, t.minute, t.second, static_cast<int>(t.nanosecond / kMillisecond_ns),
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
                                 static_cast<int>(milliseconds * kMillisecond_ns)});
  if (!utc) return std::nullopt;
  result.utc_ns = *utc;
  return result;
}

bool plainFileName(const std::string& name) {
  return !name.empty() && name != "." && name != ".." && name.find('/') == std::string::npos &&
         name.find('\0') == std::string::npos;
}

bool nameInside(const std::string& name) {
  const std::filesystem::path path(name);
  return !path.is_absolute() && std::all_of(path.begin(), path.end(), [](const std::filesystem::path& part) {
    return plainFileName(part.string());
  }) && path.has_filename();
}

ImageFile readImage(const std::filesystem::path& path, PixelFormat format, int bits, int width, int height) {
  const std::vector<std::uint8_t> bytes = readFileBytes(path, kMaxImageFileBytes, "an image");
  TiffPixels pixels;
  std::string error;
  if (!decodeTiffOrPng(bytes, pixels, error))
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
  return imageFileOf(std::move(pixels), format, bits);
}

void writeImage(const std::filesystem::path& path, const ImageView& image) {
  if (image.empty())
    throw std::invalid_argument("an image without pixels cannot be written: " + path.string());
  const std::vector<std::uint8_t> bytes = encodeTiff(image.data, image.stride, image.width, image.height,
                                                     channelsOf(image.format), image.bits == 8 ? 8 : 16);
  writeFile(path, bytes);
}

std::vector<ImageTime> readImageTimes(const std::filesystem::path& path) {
  std::vector<ImageTime> times;
  std::ifstream stream(path);
  if (!stream) return times;
  std::string line;
  std::getline(stream, line);  // the header
  for (int number = 2; std::getline(stream, line); ++number) {
    const std::size_t comma = line.find(','),
                      second = line.find(',', comma == std::string::npos ? 0 : comma + 1);
    std::int64_t utc_ns = 0;
    const auto parsed = std::from_chars(line.data(), line.data() + std::min(comma, line.size()), utc_ns);
    if (comma == std::string::npos || second == std::string::npos || parsed.ec != std::errc() ||
        parsed.ptr != line.data() + comma) {
      throw InputError(path.string(), "line " + std::to_string(number),
                       "is not utc_ns,left_image,right_image; make the mission again");
    }
    times.push_back({utc_ns, line.substr(comma + 1, second - comma - 1), line.substr(second + 1)});
  }
  return times;
}

}  // namespace fathom::io
