#include "realtime/onboard/mapper/input_feed.hpp"

#include <algorithm>
#include <utility>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"

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

using Step = io::LogInputReader::Step;

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

InputFeed::InputFeed(std::filesystem::path mission, const MapperDown& down, std::int64_t patience_ns)
    : mission_(std::move(mission)),
      down_(down),
      patience_ns_(patience_ns),
      file_(std::make_unique<io::LogInputReader>(mission_)) {}

bool InputFeed::begin(std::uint64_t number, std::uint64_t position) {
  auto file = std::make_unique<io::LogInputReader>(mission_);
  auto ahead = std::make_unique<io::LogInputReader>(mission_);
  try {
    if (number != 0 && (!file->seekBehindMark(number, position) || !ahead->seekBehindMark(number, position)))
      return false;
  } catch (const InputError&) {
    return false;
  }
  file_ = std::move(file);
  position_ = position;
  decisions_.clear();
  // A decision stands behind what it is about.
  io::LogInputReader::Entry entry;
  for (Step step = ahead->next(entry); step != Step::kEnd && step != Step::kUnreadable;
       step = ahead->next(entry))
    if (step == Step::kDecision) note(entry.input);
  return true;
}

void InputFeed::note(const io::OnboardInput& input) {
  if (const auto* decision = std::get_if<io::Decision>(&input.what))
    decisions_[decision->pair_index] = *decision;
}

std::optional<io::Decision> InputFeed::decisionOf(std::uint32_t pair) const {
  const auto found = decisions_.find(pair);
  return found == decisions_.end() ? std::nullopt : std::optional(found->second);
}

bool InputFeed::next(io::OnboardInput& input) {
  for (;;) {
    switch (down_.inputs.read(position_, input)) {
      case InputBroadcast::Read::kGot:
        ++position_;
        waiting_since_ns_ = 0;
        return true;
      case InputBroadcast::Read::kNotYet:
        return false;
      case InputBroadcast::Read::kOverrun:
        break;
    }
    // The log's end may change until the disk holds it.
    switch (position_ < down_.safe_position.load() ? nextOfFile(input) : OfFile::kNotYet) {
      case OfFile::kGot:
        return true;
      case OfFile::kMissing:
        continue;
      case OfFile::kNotYet:
        break;
    }
    if (!giveUpWaiting()) return false;
  }
}

InputFeed::OfFile InputFeed::nextOfFile(io::OnboardInput& input) {
  io::LogInputReader::Entry entry;
  for (;;) {
    switch (file_->next(entry)) {
      case Step::kInput:
        if (entry.position < position_) continue;
        skipped_ += entry.position - position_;
        position_ = entry.position + 1;
        input = entry.input;
        waiting_since_ns_ = 0;
        return OfFile::kGot;
      case Step::kDecision:
        note(entry.input);
        continue;
      case Step::kMissing:
        if (entry.position + entry.missing <= position_) continue;
        skipped_ += entry.position + entry.missing - position_;
        position_ = entry.position + entry.missing;
        return OfFile::kMissing;
      case Step::kEnd:
      case Step::kUnreadable:
        return OfFile::kNotYet;
    }
  }
}

// Nobody has it: on with what memory has, the older half left to be overrun meanwhile.
bool InputFeed::giveUpWaiting() {
  const std::int64_t now = rt::RealClock().monotonicNs();
  if (waiting_since_ns_ == 0) waiting_since_ns_ = now;
  if (now - waiting_since_ns_ < patience_ns_) return false;
  waiting_since_ns_ = 0;
  const std::uint64_t next = down_.inputs.next();
  const std::uint64_t from = next - std::min<std::uint64_t>(next, InputBroadcast::capacity() / 2);
  const std::uint64_t passed = from > position_ ? from - position_ : 0;
  skipped_ += passed;
  passed_over_ += passed;
  position_ = std::max(position_, from);
  return true;
}

}  // namespace fathom::onboard
