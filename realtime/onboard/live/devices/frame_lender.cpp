#include "realtime/onboard/live/devices/frame_lender.hpp"

#include <algorithm>

namespace fathom::onboard {

FrameLender::FrameLender(io::CameraSource& camera, FrameBroadcast& to,
                         const std::atomic<std::uint64_t>& floor, std::size_t most)
    : camera_(camera), to_(to), floor_(floor), most_(std::clamp<std::size_t>(most, 1, kMost)) {}

FrameLender::~FrameLender() {
  for (; count_ > 0; --count_, ++begin_) camera_.pool().release(loans_[begin_ % kMost].block);
}

void FrameLender::takeBack() noexcept {
  const std::uint64_t floor = floor_.load(std::memory_order_acquire);
  for (; count_ > 0 && loans_[begin_ % kMost].number < floor; --count_, ++begin_)
    camera_.pool().release(loans_[begin_ % kMost].block);
}

void FrameLender::lend(const io::CameraFrame& frame) noexcept {
  takeBack();
  if (count_ == most_) {
    refused_.fetch_add(1, std::memory_order_relaxed);
    camera_.pool().release(frame.block);
    return;
  }
  const ImageView view = camera_.view(frame);
  loans_[(begin_ + count_++) % kMost] = {frame.block, to_.next()};
  to_.push({frame, view.width, view.height, view.stride, view.format, view.bits});
}

}  // namespace fathom::onboard
