#include "firmware_if/dvl/pd0_decoder.hpp"

#include <algorithm>
#include <cstring>
#include <numeric>

namespace fathom::io {
namespace {

constexpr std::uint8_t kHeaderId = 0x7F;  // twice
constexpr std::size_t kHeaderBytes = 6;
constexpr std::size_t kChecksumBytes = 2;
constexpr std::size_t kBlockIdBytes = 2;
constexpr std::size_t kLargestLength = 65535;  // the length field has 16 bits

std::uint16_t u16(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8));
}

}  // namespace

Pd0Decoder::Pd0Decoder(const Config& config)
    : max_ensemble_bytes_(
          std::clamp(config.max_ensemble_bytes, std::size_t{64}, kLargestLength + kChecksumBytes)),
      // Twice the longest ensemble, so that moving the rest to the front is rare.
      buffer_(2 * max_ensemble_bytes_) {}

std::size_t Pd0Decoder::accept(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.empty()) return 0;
  if (buffer_.size() - end_ < bytes.size() && begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
    raw_ = {};
  }
  const std::size_t taken = std::min(bytes.size(), buffer_.size() - end_);
  std::memcpy(buffer_.data() + end_, bytes.data(), taken);
  end_ += taken;
  return taken;
}

Pd0Decoder::Candidate Pd0Decoder::inspectHeader(std::size_t& length) const noexcept {
  const std::uint8_t* header = buffer_.data() + begin_;
  const std::size_t available = end_ - begin_;
  if (available >= 2 && header[1] != kHeaderId) return Candidate::kNone;
  if (available < kHeaderBytes) return Candidate::kIncomplete;
  length = u16(header + 2);
  const std::size_t types = header[5];
  const std::size_t table_end = kHeaderBytes + 2 * types;
  if (types == 0 || length < table_end + kBlockIdBytes || length + kChecksumBytes > max_ensemble_bytes_) {
    return Candidate::kNone;
  }
  if (available < table_end) return Candidate::kIncomplete;
  for (std::size_t i = 0; i < types; ++i) {
    const std::size_t offset = u16(header + kHeaderBytes + 2 * i);
    if (offset < table_end || offset + kBlockIdBytes > length) return Candidate::kNone;
  }
  return available < length + kChecksumBytes ? Candidate::kIncomplete : Candidate::kWhole;
}

void Pd0Decoder::skip(std::size_t bytes) noexcept {
  begin_ += bytes;
  counts_.skipped_bytes += bytes;
  skipping_ = true;
}

const Pd0Ensemble* Pd0Decoder::next() noexcept {
  while (begin_ < end_) {
    const std::uint8_t* first = buffer_.data() + begin_;
    const void* found = std::memchr(first, kHeaderId, end_ - begin_);
    const std::size_t garbage =
        found == nullptr ? end_ - begin_
                         : static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - first);
    if (garbage > 0) {
      skip(garbage);
      continue;
    }
    std::size_t length = 0;
    const Candidate candidate = inspectHeader(length);
    if (candidate == Candidate::kNone) {
      skip(1);
      continue;
    }
    if (candidate == Candidate::kIncomplete) {
      if (!finishing_) return nullptr;
      if (length > 0) ++counts_.truncated;
      skip(1);
      continue;
    }
    const auto sum = static_cast<std::uint16_t>(std::accumulate(first, first + length, std::uint32_t{0}));
    if (sum != u16(first + length)) {
      ++counts_.bad_checksum;
      skip(1);
      continue;
    }
    begin_ += length + kChecksumBytes;
    if (skipping_) ++counts_.resynced;
    skipping_ = false;
    if (!readPd0Ensemble({first, length}, ensemble_)) {
      ++counts_.malformed;
      continue;
    }
    ++counts_.good;
    raw_ = {first, length + kChecksumBytes};
    return &ensemble_;
  }
  return nullptr;
}

}  // namespace fathom::io
