#include "realtime/onboard/live/program_watch.hpp"

namespace fathom::onboard {
namespace {

std::string silent(const char* part, std::int64_t limit_ns) {
  return std::string(part) + " gave no sign of life for " + std::to_string(limit_ns / 1'000'000) + " ms";
}

}  // namespace

std::int64_t ProgramWatch::Life::look(std::int64_t now_ns, std::uint64_t now_beats) {
  if (now_beats != beats || last_ns == 0) last_ns = now_ns;
  beats = now_beats;
  return now_ns - last_ns;
}

std::string ProgramWatch::look(std::int64_t now_ns, std::uint64_t navigation_beats,
                               std::uint64_t supervisor_beats) {
  const std::int64_t navigation_ns = navigation_.look(now_ns, navigation_beats),
                     supervisor_ns = supervisor_.look(now_ns, supervisor_beats);
  alive_ = navigation_ns < config_.navigation_ns;
  if (!alive_) return silent("navigation", config_.navigation_ns);
  if (supervisor_ns >= config_.supervisor_ns) return silent("the supervisor", config_.supervisor_ns);
  return "";
}

}  // namespace fathom::onboard
