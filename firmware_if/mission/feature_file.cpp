#include "firmware_if/mission/feature_file.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::array<std::uint8_t, 4> kFeatureMagic{'F', 'S', 'F', 'T'};
constexpr std::uint16_t kFeatureVersion = 2;
constexpr std::size_t kFeatureHeaderBytes = 12, kRecordBytes = 18 + std::tuple_size_v<RootSift>,
                      kFileCrcBytes = 4;
constexpr std::size_t kMaxFeatures = 65535;
constexpr std::size_t kMaxFeatureFileBytes =
    kFeatureHeaderBytes + kMaxFeatures * kRecordBytes + kFileCrcBytes;
constexpr int kMaxSide = 8192;  // of an image [px]
// Steps of the stored numbers.
constexpr double kPixelStep = 1.0 / 512, kSizeStep = 0.5, kPlaceStep = 1.0 / 128, kMatchStep = 1.0 / 512;
constexpr double kBorder = 0.5;  // of the image beyond the outermost pixels' centres [px]

class FeatureFileBytes {
 public:
  explicit FeatureFileBytes(std::size_t size) { out_.reserve(size); }
  void put(std::uint64_t value, std::size_t bytes) {
    out_.resize(out_.size() + bytes);
    writeLittleEndian(std::span(out_).last(bytes), value);
  }
  // To the nearest step that the byte holds; never 0.
  void step(float value, double step) {
    put(static_cast<std::uint64_t>(std::clamp(std::lround(static_cast<double>(value) / step), 1L, 255L)), 1);
  }
  void bytes(std::span<const std::uint8_t> values) { out_.insert(out_.end(), values.begin(), values.end()); }
  void pixel(float value) {
    put(static_cast<std::uint64_t>(std::lround(static_cast<double>(value) / kPixelStep)), 3);
  }
  std::vector<std::uint8_t> out_;
};

class FeatureFileCursor {
 public:
  explicit FeatureFileCursor(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::uint64_t take(std::size_t count) {
    at_ += count;
    return readLittleEndian(bytes_.subspan(at_ - count, count));
  }
  void bytes(std::span<std::uint8_t> values) {
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at_), values.size(), values.begin());
    at_ += values.size();
  }
  float step(double step) { return static_cast<float>(static_cast<double>(take(1)) * step); }
  float pixel() {
    const auto raw = static_cast<std::int32_t>(take(3) << 8) >> 8;  // 24 bits, signed
    return static_cast<float>(raw * kPixelStep);
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

bool insideImage(const Eigen::Vector2f& pixel, double width, double height) {
  const double x = static_cast<double>(pixel.x()), y = static_cast<double>(pixel.y());
  return x >= -kBorder && y >= -kBorder && x <= width - 1 + kBorder && y <= height - 1 + kBorder;
}

// Null when the feature can be; else what is wrong with it. The right image's size is not in the file: its
// pixels are bounded by the largest image.
const char* faultOf(const StereoFeature& f, int width, int height) {
  if (!insideImage(f.left, width, height)) return "its left pixel is outside the image";
  if (!insideImage(f.right, kMaxSide, kMaxSide)) return "its right pixel is outside any image";
  if (!(f.size > 0)) return "its size is not positive";
  if (!(f.place_sigma > 0) || !(f.match_sigma > 0)) return "a standard deviation is not positive";
  return nullptr;
}

bool sizeFits(int width, int height) {
  return width >= 1 && height >= 1 && width <= kMaxSide && height <= kMaxSide;
}

void parseInto(std::span<const std::uint8_t> bytes, const std::string& name, StereoFeatureFrame& frame) {
  if (bytes.size() < kFeatureHeaderBytes + kFileCrcBytes ||
      !std::equal(kFeatureMagic.begin(), kFeatureMagic.end(), bytes.begin()))
    throw InputError(name, "byte 0", "is no feature file; give one that fathom-sim render --features wrote");
  FeatureFileCursor in(bytes.subspan(kFeatureMagic.size()));
  const auto version = in.take(2);
  if (version != kFeatureVersion)
    throw InputError(name, "byte 4",
                     "has version " + std::to_string(version) + ", this program reads " +
                         std::to_string(kFeatureVersion) + "; make the mission again");
  const std::size_t count = in.take(2);
  const std::size_t expected = kFeatureHeaderBytes + count * kRecordBytes + kFileCrcBytes;
  if (bytes.size() != expected)
    throw InputError(name, "byte 6",
                     "has " + std::to_string(bytes.size()) + " bytes where its " + std::to_string(count) +
                         " features take " + std::to_string(expected) + "; copy it again");
  const std::size_t checked = bytes.size() - kFileCrcBytes;
  if (FeatureFileCursor(bytes.subspan(checked)).take(kFileCrcBytes) != crc32(bytes.first(checked)))
    throw InputError(name, "byte " + std::to_string(checked),
                     "its CRC is wrong: the file is damaged; copy it again");
  frame.width = static_cast<int>(in.take(2));
  frame.height = static_cast<int>(in.take(2));
  if (!sizeFits(frame.width, frame.height))
    throw InputError(name, "byte 8", "the image's size is none; make the mission again");
  for (std::size_t i = 0; i < count; ++i) {
    StereoFeature f;
    f.left.x() = in.pixel();
    f.left.y() = in.pixel();
    f.right.x() = in.pixel();
    f.right.y() = in.pixel();
    f.size = in.step(kSizeStep);
    f.place_sigma = in.step(kPlaceStep);
    f.match_sigma = in.step(kMatchStep);
    in.bytes(f.colour);
    in.bytes(f.descriptor);
    if (const char* fault = faultOf(f, frame.width, frame.height))
      throw InputError(name, "feature " + std::to_string(i + 1),
                       std::string(fault) + "; make the mission again");
    frame.features.push_back(f);
  }
}

}  // namespace

std::string featureFileName(const std::string& left_image_name) {
  return std::filesystem::path(left_image_name).replace_extension(".feat").string();
}

bool isFeatureMission(const MissionPaths& paths) {
  std::error_code error;
  return std::filesystem::is_directory(paths.features(), error) &&
         !std::filesystem::is_directory(paths.images(), error);
}

StereoFeatureFrame readFeatureFile(const std::filesystem::path& path) {
  StereoFeatureFrame frame;
  readFeatureFile(path, frame);
  return frame;
}

void readFeatureFile(const std::filesystem::path& path, StereoFeatureFrame& frame) {
  frame.features.clear();
  parseFeatureFile(readFileBytes(path, kMaxFeatureFileBytes, "a feature file"), path.string(), frame);
}

void parseFeatureFile(std::span<const std::uint8_t> bytes, const std::string& name,
                      StereoFeatureFrame& frame) {
  frame.features.clear();
  try {
    parseInto(bytes, name, frame);
  } catch (const InputError&) {
    frame.features.clear();
    throw;
  }
}

std::vector<std::uint8_t> encodeFeatureFile(const StereoFeatureFrame& frame) {
  if (frame.features.size() > kMaxFeatures)
    throw std::invalid_argument("feature file: more than 65535 features");
  if (!sizeFits(frame.width, frame.height))
    throw std::invalid_argument("feature file: the image's size must be 1 to 8192 px a side");
  FeatureFileBytes out(kFeatureHeaderBytes + frame.features.size() * kRecordBytes + kFileCrcBytes);
  out.bytes(kFeatureMagic);
  out.put(kFeatureVersion, 2);
  out.put(frame.features.size(), 2);
  out.put(static_cast<std::uint64_t>(frame.width), 2);
  out.put(static_cast<std::uint64_t>(frame.height), 2);
  for (const StereoFeature& f : frame.features) {
    if (const char* fault = faultOf(f, frame.width, frame.height))
      throw std::invalid_argument(std::string("feature file: of a feature, ") + fault);
    for (const float v : {f.left.x(), f.left.y(), f.right.x(), f.right.y()}) out.pixel(v);
    out.step(f.size, kSizeStep);
    out.step(f.place_sigma, kPlaceStep);
    out.step(f.match_sigma, kMatchStep);
    out.bytes(f.colour);
    out.bytes(f.descriptor);
  }
  out.put(crc32(out.out_), kFileCrcBytes);
  return std::move(out.out_);
}

void writeFeatureFile(const std::filesystem::path& path, const StereoFeatureFrame& frame) {
  const std::vector<std::uint8_t> bytes = encodeFeatureFile(frame);
  writeFile(path, bytes);
}

}  // namespace fathom::io
