#include "telemetry/wire/bundle.hpp"

#include <algorithm>

namespace fathom::telemetry {
namespace {

bool isBundle(std::span<const std::uint8_t> modem_frame) {
  return !modem_frame.empty() && modem_frame[0] == kBundleMark;
}

}  // namespace

LinkFrames::LinkFrames(std::span<const std::uint8_t> modem_frame)
    : rest_(modem_frame), bundle_(isBundle(modem_frame)) {
  if (bundle_) rest_ = rest_.subspan(kBundleHeadBytes);
}

std::optional<std::span<const std::uint8_t>> LinkFrames::next() {
  if (rest_.empty()) return std::nullopt;
  std::span<const std::uint8_t> frame = rest_;
  rest_ = {};
  if (!bundle_) return frame;
  const std::size_t size = std::size_t{frame[0]} + 1;
  if (frame[0] == 0 || frame.size() < kBundleShareBytes + size) return std::nullopt;
  rest_ = frame.subspan(kBundleShareBytes + size);
  return frame.subspan(kBundleShareBytes, size);
}

std::size_t paddedBytes(std::span<const std::uint8_t> modem_frame) {
  if (!isBundle(modem_frame)) return 0;
  std::size_t used = kBundleHeadBytes;
  LinkFrames frames(modem_frame);
  while (const auto frame = frames.next()) used += kBundleShareBytes + frame->size();
  const auto padding = modem_frame.subspan(used);
  const bool zeros = std::all_of(padding.begin(), padding.end(), [](std::uint8_t b) { return b == 0; });
  return padding.empty() || !zeros ? 0 : modem_frame.size();
}

std::size_t ModemFrameWriter::place() const {
  if (frames_ == 0) return padded_ ? kBundleHeadBytes + kBundleShareBytes : 0;
  return kBundleHeadBytes + (frames_ + 1) * kBundleShareBytes + bytes_;
}

std::span<std::uint8_t> ModemFrameWriter::room() const {
  const std::size_t begin = std::min(place(), out_.size());
  return out_.subspan(begin, std::min(out_.size() - begin, kMaxFrameBytes));
}

void ModemFrameWriter::add(std::size_t size) {
  const bool first_was_alone = frames_ == 1 && !padded_;
  if (first_was_alone) {
    const auto first = out_.first(bytes_);
    std::copy_backward(
        first.begin(), first.end(),
        out_.begin() + static_cast<std::ptrdiff_t>(kBundleHeadBytes + kBundleShareBytes + bytes_));
    out_[kBundleHeadBytes] = static_cast<std::uint8_t>(bytes_ - 1);
  }
  if (frames_ > 0 || padded_) {
    out_[0] = kBundleMark;
    out_[place() - kBundleShareBytes] = static_cast<std::uint8_t>(size - 1);
  }
  ++frames_;
  bytes_ += size;
}

std::size_t ModemFrameWriter::bytesWith(std::size_t more) const {
  return padded_ ? out_.size() : place() + more;
}

std::size_t ModemFrameWriter::finish() {
  if (frames_ == 0) return 0;
  if (frames_ == 1 && !padded_) return bytes_;
  const std::size_t used = place() - kBundleShareBytes;
  if (!padded_) return used;
  std::fill(out_.begin() + static_cast<std::ptrdiff_t>(used), out_.end(), std::uint8_t{0});
  return out_.size();
}

}  // namespace fathom::telemetry
