#include "realtime/onboard/live/held_frames.hpp"

#include <algorithm>

#include "firmware_if/files/images/image_file.hpp"

namespace fathom::onboard {

HeldFrames::HeldFrames(FrameRing& left_ring, io::CameraSource& left, FrameRing& right_ring,
                       io::CameraSource& right, std::size_t most)
    : most_(std::clamp<std::size_t>(most, 2, kMost)) {
  sides_[0].ring = &left_ring;
  sides_[0].camera = &left;
  sides_[1].ring = &right_ring;
  sides_[1].camera = &right;
}

HeldFrames::~HeldFrames() {
  refill();
  for (Side& side : sides_) dropOldest(side, side.count);
}

void HeldFrames::dropOldest(Side& side, std::size_t frames) {
  for (std::size_t i = 0; i < frames; ++i) side.camera->pool().release(side.frames[i].block);
  std::move(side.frames.begin() + static_cast<std::ptrdiff_t>(frames),
            side.frames.begin() + static_cast<std::ptrdiff_t>(side.count), side.frames.begin());
  side.count -= frames;
}

void HeldFrames::refill() {
  for (Side& side : sides_) {
    io::CameraFrame frame;
    while (side.ring->pop(frame)) {
      if (side.count == most_) {
        dropOldest(side, 1);
        ++unused_;
      }
      side.frames[side.count++] = frame;
    }
  }
}

const io::CameraFrame* HeldFrames::frameOf(const Side& side, const std::string& file_name) {
  for (std::size_t i = 0; i < side.count; ++i)
    if (io::imageFileName(side.frames[i].utc_ns, side.frames[i].side).view() == file_name)
      return &side.frames[i];
  return nullptr;
}

std::optional<ImageView> HeldFrames::find(const std::string& file_name, CameraSide side) {
  refill();
  const Side& of = sides_[static_cast<std::size_t>(side)];
  const io::CameraFrame* frame = frameOf(of, file_name);
  if (frame == nullptr) return std::nullopt;
  return of.camera->view(*frame);
}

std::optional<std::int64_t> HeldFrames::arrivalOf(const std::string& left_image,
                                                  const std::string& right_image) {
  const io::CameraFrame *left = frameOf(sides_[0], left_image), *right = frameOf(sides_[1], right_image);
  if (left == nullptr || right == nullptr) return std::nullopt;
  return std::max(left->arrival_utc_ns, right->arrival_utc_ns);
}

void HeldFrames::releaseUpTo(Side& side, const std::string& file_name) {
  const io::CameraFrame* frame = frameOf(side, file_name);
  if (frame == nullptr) return;
  const auto older = static_cast<std::size_t>(frame - side.frames.data());
  unused_ += older;
  dropOldest(side, older + 1);
}

void HeldFrames::release(const std::string& left_image, const std::string& right_image) {
  releaseUpTo(sides_[0], left_image);
  releaseUpTo(sides_[1], right_image);
}

}  // namespace fathom::onboard
