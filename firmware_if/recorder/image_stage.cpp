#include "firmware_if/recorder/image_stage.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <optional>
#include <span>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/bytes/byte_order.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::io {
namespace {

constexpr char kUnfinished[] = ".tmp";

bool writeToFile(int fd, const void* data, std::size_t size) {
  const auto* from = static_cast<const std::uint8_t*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd, from, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    from += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool writePixelRows(int fd, const ImageView& image) {
  const std::size_t row_bytes = rowBytes(image);
  if (image.stride == row_bytes)
    return writeToFile(fd, image.data, row_bytes * static_cast<std::size_t>(image.height));
  const auto* row = static_cast<const std::uint8_t*>(image.data);
  for (int y = 0; y < image.height; ++y, row += image.stride)
    if (!writeToFile(fd, row, row_bytes)) return false;
  return true;
}

static_assert(std::endian::native == std::endian::little,
              "16 bit samples go to the file as they are in memory");

enum TiffType : std::uint16_t { kShort = 3, kLong = 4 };

int channelCount(const ImageView& image) {
  return image.format == PixelFormat::kRgb ? 3 : 1;
}

// The one directory of the file: entries behind the file's 8 byte header, values too long for an entry behind
// them.
class TiffDirectory {
 public:
  static constexpr std::size_t kEntries = 11;
  explicit TiffDirectory(TiffHead& head) : head_(head) {
    constexpr std::size_t kFileHeader = 8;
    head_[0] = head_[1] = 'I';
    put(2, 42, 2);
    put(4, kFileHeader, 4);
    put(kFileHeader, kEntries, 2);
    entry_ = kFileHeader + 2;
    values_ = entry_ + 12 * kEntries + 4;
  }
  // `value(i)` gives the i-th of `count` values.
  template <class Value>
  void add(std::uint16_t tag, TiffType type, std::size_t count, const Value& value) {
    const std::size_t bytes = type == kShort ? 2 : 4;
    put(entry_, tag, 2);
    put(entry_ + 2, type, 2);
    put(entry_ + 4, count, 4);
    std::size_t at = entry_ + 8;
    if (bytes * count > 4) {
      put(at, values_, 4);
      at = values_;
      values_ += bytes * count + (bytes * count) % 2;
    }
    for (std::size_t i = 0; i < count; ++i) put(at + bytes * i, value(i), bytes);
    entry_ += 12;
  }
  void add(std::uint16_t tag, TiffType type, std::uint64_t value) {
    add(tag, type, 1, [value](std::size_t) { return value; });
  }

 private:
  void put(std::size_t at, std::uint64_t value, std::size_t bytes) {
    writeLittleEndian(std::span(head_).subspan(at, bytes), value);
  }

  TiffHead& head_;
  std::size_t entry_ = 0, values_ = 0;
};

constexpr std::array<CameraSide, 2> kBothSides = {CameraSide::kLeft, CameraSide::kRight};
// A disk that takes longer for one image of each camera cannot also sync inputs within a second.
constexpr std::int64_t kMostImageTime_ns = 700 * kMillisecond_ns;

}  // namespace

std::size_t rowBytes(const ImageView& image) {
  return static_cast<std::size_t>(image.width) * static_cast<std::size_t>(channelCount(image)) *
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
  const auto channels = static_cast<std::size_t>(channelCount(image));

  TiffHead head = {};
  TiffDirectory directory(head);
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

bool ImageWriter::refused(int error) noexcept {
  error_ = error;
  return false;
}

bool ImageWriter::write(const std::string& name, const ImageView& image) noexcept {
  if (!folder_.open()) folder_.reset(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder_.open()) return refused(errno);
  if (::faccessat(folder_.get(), name.c_str(), F_OK, 0) == 0) return refused(EEXIST);
  const std::string half = name + kUnfinished;
  Pending file;
  file.file.reset(::openat(folder_.get(), half.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file.file.open()) return refused(errno);
  file.name = name;
  file.bytes = tiffBytes(image);
  // Not every file system can take room beforehand; then the writing finds out.
  const int taken = ::fallocate(file.file.get(), 0, 0, static_cast<off_t>(file.bytes));
  const bool room = taken == 0 || errno == EOPNOTSUPP || errno == ENOSYS;
  const TiffHead head = tiffHead(image);
  if (!room || !writeToFile(file.file.get(), head.data(), head.size()) ||
      !writePixelRows(file.file.get(), image)) {
    const int error = errno;
    ::unlinkat(folder_.get(), half.c_str(), 0);
    return refused(error);
  }
  ::sync_file_range(file.file.get(), 0, 0, SYNC_FILE_RANGE_WRITE);
  pending_.push_back(std::move(file));
  return true;
}

bool ImageWriter::commit() noexcept {
  if (pending_.empty()) return true;
  bool good = true;
  for (const Pending& file : pending_) good = good && ::fdatasync(file.file.get()) == 0;
  for (const Pending& file : pending_)
    good = good && ::renameat(folder_.get(), (file.name + kUnfinished).c_str(), folder_.get(),
                              file.name.c_str()) == 0;
  good = good && ::fsync(folder_.get()) == 0;
  if (!good) {
    const int error = errno;
    discard();
    return refused(error);
  }
  for (const Pending& file : pending_) {
    bytes_ += file.bytes;
    ::posix_fadvise(file.file.get(), 0, 0, POSIX_FADV_DONTNEED);
  }
  pending_.clear();
  return true;
}

void ImageWriter::discard() noexcept {
  for (const Pending& file : pending_) {
    ::unlinkat(folder_.get(), (file.name + kUnfinished).c_str(), 0);
    ::unlinkat(folder_.get(), file.name.c_str(), 0);
  }
  pending_.clear();
}

ImageStage::ImageStage(const std::filesystem::path& folder, std::size_t most_waiting, ViewOf view_of,
                       Release release)
    : view_of_(std::move(view_of)),
      release_(std::move(release)),
      writer_(folder),
      lanes_{ImageLane(most_waiting), ImageLane(most_waiting)} {}

bool ImageStage::offer(const CameraFrame& frame) noexcept {
  if (laneOf(frame.side).offer(frame)) return true;
  release_(frame);
  return false;
}

void ImageStage::step(bool room) {
  const rt::RealClock clock;
  const std::int64_t start = clock.monotonicNs();
  const bool too_slow = time_ns_ > kMostImageTime_ns;
  if (room && waiting()) error_ = 0;
  std::array<std::optional<std::int64_t>, 2> written;  // times of what is to be committed
  for (const CameraSide side : kBothSides) {
    CameraFrame frame;
    if (!laneOf(side).take(frame)) continue;
    if (room && !too_slow && write(frame)) {
      written[static_cast<std::size_t>(side)] = frame.utc_ns;
    } else {
      ++(room && too_slow ? counters_.dropped_slow : counters_.dropped_disk);
      if (room && too_slow) time_ns_ -= time_ns_ / 4;  // tried again when some were left out
      laneOf(side).settle(frame.utc_ns, false);
    }
    release_(frame);
  }
  if (!written[0] && !written[1]) return;
  const bool good = writer_.commit();
  if (!good) ++counters_.failures;
  if (!good) error_ = writer_.error();
  for (const CameraSide side : kBothSides) {
    const auto utc_ns = written[static_cast<std::size_t>(side)];
    if (!utc_ns) continue;
    ++(good ? counters_.written : counters_.dropped_disk);
    if (laneOf(side).settle(*utc_ns, good)) ++counters_.without_input;
  }
  time_ns_ = clock.monotonicNs() - start;
}

bool ImageStage::write(const CameraFrame& frame) {
  const ImageView view = view_of_(frame);
  const bool good = !view.empty() && writer_.write(imageFileName(frame.utc_ns, frame.side), view);
  if (good) return true;
  ++counters_.failures;
  if (!view.empty()) error_ = writer_.error();
  return false;
}

void ImageStage::named(CameraSide side, std::int64_t utc_ns) noexcept {
  counters_.without_input += laneOf(side).forget(utc_ns);
}

std::size_t ImageStage::highWater() const noexcept {
  return std::max(lanes_[0].highWater(), lanes_[1].highWater());
}

}  // namespace fathom::io
