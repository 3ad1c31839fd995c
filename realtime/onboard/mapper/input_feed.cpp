#include "realtime/onboard/mapper/input_feed.hpp"

#include <algorithm>
#include <utility>

#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::onboard {
namespace {

using Step = io::LogInputReader::Step;

}  // namespace

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
