#include "realtime/onboard/live/part_states.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace fathom::onboard {

const char* nameOf(PartState state) {
  constexpr std::array<const char*, 5> kNames = {"starting", "catching up", "running", "failed", "ended"};
  return kNames[static_cast<std::size_t>(state)];
}

bool PartStates::set(std::string_view name, PartState state, std::string reason) {
  const std::lock_guard<std::mutex> lock(mutex_);
  auto part = std::find_if(parts_.begin(), parts_.end(), [&](const auto& p) { return p.name == name; });
  if (part == parts_.end()) part = parts_.insert(parts_.end(), {std::string(name), PartState::kStarting, ""});
  const bool other = part->state != state;
  part->state = state;
  part->reason = std::move(reason);
  return other;
}

std::vector<PartReport> PartStates::read() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return parts_;
}

PartReport PartStates::read(std::string_view name) const {
  for (const PartReport& part : read())
    if (part.name == name) return part;
  return {std::string(name), PartState::kStarting, ""};
}

}  // namespace fathom::onboard
