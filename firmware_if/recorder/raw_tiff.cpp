#include "firmware_if/recorder/raw_tiff.hpp"

#include <algorithm>
#include <bit>

namespace fathom::io {
namespace {

static_assert(std::endian::native == std::endian::little,
              "16 bit samples go to the file as they lie in memory");

enum Type : std::uint16_t { kShort = 3, kLong = 4 };

int channelsOf(const ImageView& image) {
  return image.format == PixelFormat::kRgb ? 3 : 1;
}

void put(TiffHead& head, std::size_t at, std::uint64_t value, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i) head[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

// The one directory of the file: entries behind the file's 8 byte header, values that do not fit an entry
// behind the entries.
class Directory {
 public:
  static constexpr std::size_t kEntries = 11;
  explicit Directory(TiffHead& head) : head_(head) {
    constexpr std::size_t kFileHeader = 8;
    head_[0] = head_[1] = 'I';
    put(head_, 2, 42, 2);
    put(head_, 4, kFileHeader, 4);
    put(head_, kFileHeader, kEntries, 2);
    entry_ = kFileHeader + 2;
    values_ = entry_ + 12 * kEntries + 4;
  }
  // `value(i)` gives the i-th of `count` values.
  template <class Value>
  void add(std::uint16_t tag, Type type, std::size_t count, const Value& value) {
    const std::size_t bytes = type == kShort ? 2 : 4;
    put(head_, entry_, tag, 2);
    put(head_, entry_ + 2, type, 2);
    put(head_, entry_ + 4, count, 4);
    std::size_t at = entry_ + 8;
    if (bytes * count > 4) {
      put(head_, at, values_, 4);
      at = values_;
      values_ += bytes * count + (bytes * count) % 2;
    }
    for (std::size_t i = 0; i < count; ++i) put(head_, at + bytes * i, value(i), bytes);
    entry_ += 12;
  }
  void add(std::uint16_t tag, Type type, std::uint64_t value) {
    add(tag, type, 1, [value](std::size_t) { return value; });
  }

 private:
  TiffHead& head_;
  std::size_t entry_ = 0, values_ = 0;
};

}  // namespace

std::size_t rowBytes(const ImageView& image) {
  return static_cast<std::size_t>(image.width) * static_cast<std::size_t>(channelsOf(image)) *
         (image.bits == 8 ? 1 : 2);
}

std::size_t tiffBytes(const ImageView& image) {
  return kTiffHeadBytes + rowBytes(image) * static_cast<std::size_t>(image.height);
}

TiffHead tiffHead(const ImageView& image) {
  constexpr std::size_t kUsualRowsPerStrip = 64, kMostStrips = 256;  // so that the head holds their table
  const auto height = static_cast<std::size_t>(image.height);
  const std::size_t rows = std::max(kUsualRowsPerStrip, (height + kMostStrips - 1) / kMostStrips);
  const std::size_t strips = (height + rows - 1) / rows;
  const std::size_t row_bytes = rowBytes(image);
  const auto channels = static_cast<std::size_t>(channelsOf(image));

  TiffHead head = {};
  Directory directory(head);
  directory.add(256, kLong, static_cast<std::uint64_t>(image.width));
  directory.add(257, kLong, height);
  directory.add(258, kShort, channels, [&](std::size_t) { return image.bits == 8 ? 8u : 16u; });
  directory.add(259, kShort, 1);                      // not compressed
  directory.add(262, kShort, channels == 3 ? 2 : 1);  // RGB, or grey with black at zero
  directory.add(273, kLong, strips, [&](std::size_t i) { return kTiffHeadBytes + i * rows * row_bytes; });
  directory.add(277, kShort, channels);
  directory.add(278, kLong, rows);
  directory.add(279, kLong, strips,
                [&](std::size_t i) { return std::min(rows, height - i * rows) * row_bytes; });
  directory.add(284, kShort, 1);                                         // samples of a pixel together
  directory.add(339, kShort, channels, [](std::size_t) { return 1u; });  // unsigned
  return head;
}

}  // namespace fathom::io
