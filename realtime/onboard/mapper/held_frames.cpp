#include "realtime/onboard/mapper/held_frames.hpp"

#include <algorithm>

#include "firmware_if/mission/images/image_file.hpp"

namespace fathom::onboard {
namespace {

// Of the pixels' bits no others are set, as a file of them is read: a replay must map the same pairs.
bool withinBits(const ImageView& image) {
  if (image.bits == 8 || image.bits >= 16) return true;
  const std::size_t samples =
      static_cast<std::size_t>(image.width) * (image.format == PixelFormat::kRgb ? 3 : 1);
  unsigned all = 0;
  for (int y = 0; y < image.height; ++y) {
    const auto* row = reinterpret_cast<const std::uint16_t*>(static_cast<const std::byte*>(image.data) +
                                                             static_cast<std::size_t>(y) * image.stride);
    for (std::size_t i = 0; i < samples; ++i) all |= row[i];
  }
  return all >> static_cast<unsigned>(image.bits) == 0;
}

}  // namespace

HeldFrames::HeldFrames(const MapperDown& down, MapperUp& up, int left_pool, int right_pool, std::size_t most)
    : most_(std::clamp<std::size_t>(most, 2, kMost)) {
  for (std::size_t i = 0; i < sides_.size(); ++i) {
    Side& side = sides_[i];
    side.ring = &down.frames[i];
    side.floor = &up.frame_floor[i];
    side.place = down.pools[i];
    side.pool = std::make_unique<rt::SharedMemory>(i == 0 ? left_pool : right_pool, side.place.bytes, false);
    // What an earlier mapper had is on the disk.
    side.next = side.ring->next();
    side.floor->store(side.next, std::memory_order_release);
  }
}

HeldFrames::~HeldFrames() {
  for (Side& side : sides_) side.floor->store(side.ring->next(), std::memory_order_release);
}

void HeldFrames::dropOldest(Side& side, std::size_t frames) {
  std::move(side.frames.begin() + static_cast<std::ptrdiff_t>(frames),
            side.frames.begin() + static_cast<std::ptrdiff_t>(side.count), side.frames.begin());
  side.count -= frames;
  side.floor->store(side.count > 0 ? side.frames[0].number : side.next, std::memory_order_release);
}

void HeldFrames::refill() {
  for (Side& side : sides_) {
    Held held;
    for (;;) {
      const FrameBroadcast::Read got = side.ring->read(side.next, held.lent);
      if (got == FrameBroadcast::Read::kNotYet) break;
      held.number = side.next++;
      if (got == FrameBroadcast::Read::kOverrun || held.lent.frame.block >= side.place.blocks) {
        ++unused_;
        continue;
      }
      if (side.count == most_) {
        dropOldest(side, 1);
        ++unused_;
      }
      side.frames[side.count++] = held;
    }
    if (side.count == 0) side.floor->store(side.next, std::memory_order_release);
  }
}

const HeldFrames::Held* HeldFrames::frameOf(const Side& side, const std::string& file_name) {
  for (std::size_t i = 0; i < side.count; ++i) {
    const io::CameraFrame& frame = side.frames[i].lent.frame;
    if (io::imageFileName(frame.utc_ns, frame.side).view() == file_name) return &side.frames[i];
  }
  return nullptr;
}

bool HeldFrames::has(const std::string& file_name, CameraSide side) {
  refill();
  return frameOf(sides_[static_cast<std::size_t>(side)], file_name) != nullptr;
}

std::optional<ImageView> HeldFrames::find(const std::string& file_name, CameraSide side) {
  refill();
  const Side& of = sides_[static_cast<std::size_t>(side)];
  const Held* held = frameOf(of, file_name);
  if (held == nullptr) return std::nullopt;
  const LentFrame& lent = held->lent;
  const ImageView view{of.pool->data() + lent.frame.block * of.place.stride,
                       lent.width,
                       lent.height,
                       static_cast<std::size_t>(lent.stride),
                       lent.format,
                       lent.bits};
  return withinBits(view) ? std::optional(view) : std::nullopt;
}

std::optional<std::int64_t> HeldFrames::arrivalOf(const std::string& left_image,
                                                  const std::string& right_image) {
  const Held *left = frameOf(sides_[0], left_image), *right = frameOf(sides_[1], right_image);
  if (left == nullptr || right == nullptr) return std::nullopt;
  return std::max(left->lent.frame.arrival_utc_ns, right->lent.frame.arrival_utc_ns);
}

void HeldFrames::releaseUpTo(Side& side, const std::string& file_name) {
  const Held* held = frameOf(side, file_name);
  if (held == nullptr) return;
  const auto older = static_cast<std::size_t>(held - side.frames.data());
  unused_ += older;
  dropOldest(side, older + 1);
}

void HeldFrames::release(const std::string& left_image, const std::string& right_image) {
  releaseUpTo(sides_[0], left_image);
  releaseUpTo(sides_[1], right_image);
}

}  // namespace fathom::onboard
