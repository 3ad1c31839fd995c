#include "firmware_if/devices/dvl/ensemble_stream.hpp"

#include <algorithm>
#include <cstring>
#include <numeric>

#include "realtime/base/bytes/byte_order.hpp"

namespace fathom::io {

EnsembleStream::EnsembleStream(std::uint8_t first_byte, std::size_t longest, ReadHeader read_header)
    : first_byte_(first_byte),
      longest_(longest),
      read_header_(read_header),
      // Twice the longest ensemble, so that moving the rest to the front is rare.
      buffer_(2 * longest) {}

std::size_t EnsembleStream::accept(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.empty()) return 0;
  if (buffer_.size() - end_ < bytes.size() && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  const std::size_t taken = std::min(bytes.size(), buffer_.size() - end_);
  std::memcpy(buffer_.data() + end_, bytes.data(), taken);
  end_ += taken;
  return taken;
}

void EnsembleStream::skip(std::size_t bytes) noexcept {
  begin_ += bytes;
  counts_.skipped_bytes += bytes;
  skipping_ = true;
}

std::span<const std::uint8_t> EnsembleStream::next() noexcept {
  while (begin_ < end_) {
    const auto rest = std::span<const std::uint8_t>(buffer_).subspan(begin_, end_ - begin_);
    const auto found = std::find(rest.begin(), rest.end(), first_byte_);
    if (found != rest.begin()) {
      skip(static_cast<std::size_t>(found - rest.begin()));
      continue;
    }
    const Header header = read_header_(rest, longest_);
    if (header.state == Header::State::kNone) {
      skip(1);
      continue;
    }
    if (header.state == Header::State::kIncomplete || rest.size() < header.size) {
      if (!finishing_) return {};
      if (header.size > 0) ++counts_.truncated;
      skip(1);
      continue;
    }
    const auto summed = rest.first(header.size - kChecksumBytes);
    const auto sum =
        static_cast<std::uint16_t>(std::accumulate(summed.begin(), summed.end(), std::uint32_t{0}));
    if (sum != littleEndianAt<std::uint16_t>(rest, summed.size())) {
      ++counts_.bad_checksum;
      skip(1);
      continue;
    }
    begin_ += header.size;
    if (skipping_) ++counts_.resynced;
    skipping_ = false;
    return rest.first(header.size);
  }
  return {};
}

}  // namespace fathom::io
