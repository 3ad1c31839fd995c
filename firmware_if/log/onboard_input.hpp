#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "firmware_if/log/log_messages.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Everything that fathom-onboard's cores consume, in one order: the log of a live run holds exactly this
// sequence, so that it replays to the same bytes. Channels beside those of log_messages.hpp:
//
//   FATHOM_MODEM_IN   fathom.raw_t       a link frame that the modem received, by itself or in a bundle
//   FATHOM_TICK       fathom.tick_t      time passes: health is looked at, frames are sent
//   FATHOM_DECISION   fathom.decision_t  what a measured time or a full queue decided about a pair
//   FATHOM_MARK       fathom.mark_t      a state was saved, the program started again, the survey ended, ...

// A link frame, as long as one may be; what the modem gives at once may hold several and is longer.
struct ModemFrame {
  std::uint16_t size = 0;
  std::array<std::uint8_t, 256> bytes{};
  [[nodiscard]] std::span<const std::uint8_t> data() const { return {bytes.data(), size}; }
};

struct Tick {};

// Of the soft tier about one stereo pair, logged when it is made; replay looks it up by the pair.
struct Decision {
  std::uint32_t pair_index = 0;
  std::uint8_t level = 0;  // of degradation: 0 none (realtime/kernel/tiers/overload_rule.hpp)
  bool dropped = false;    // the pair is not mapped
};

struct Mark {
  enum class Kind : std::uint8_t {
    kCheckpoint = 0,
    kRestart = 1,
    kEnd = 2,
    kHealth = 3,
    kMapperLost = 4,
    kSent = 5
  };
  // Of a kRestart: nothing that was mapped before could be gone on with.
  static constexpr std::uint64_t kAnew = INT64_MAX;
  Kind kind = Kind::kEnd;
  // kCheckpoint: the state after all inputs before this mark may have been saved as `number`. kMapperLost:
  // whoever maps is gone; from here on the link is silent. kSent: frames up to before `number` have just been
  // given to the modem. kRestart: the mapper came back with checkpoint `number`, consumed again what is
  // logged behind its mark, and the link speaks again; 0: from the beginning of the log; kAnew: from there,
  // but no pair before this mark is mapped. kHealth: from now on these health flags (telemetry's bits) hold
  // of what the cores cannot see: privileges, disk, overload. kEnd: the survey is over.
  std::uint64_t number = 0;
};

// Owns no memory, so that it crosses the rings of the hard tier: copying never throws and never calls the
// heap.
struct OnboardInput {
  using What = std::variant<SensorSample, ModemFrame, Tick, Decision, Mark>;

  OnboardInput() noexcept = default;
  OnboardInput(std::int64_t arrival, const What& input) noexcept : arrival_utc_ns(arrival), what(input) {}
  OnboardInput(const OnboardInput&) noexcept = default;
  OnboardInput& operator=(const OnboardInput&) noexcept = default;

  std::int64_t arrival_utc_ns = 0;  // never falls within one run of the program
  What what = Tick{};
};

inline constexpr std::string_view kDecisionChannel = "FATHOM_DECISION", kMarkChannel = "FATHOM_MARK";

// The exposure that an input tells of, or null.
[[nodiscard]] inline const ImageEvent* imageOf(const OnboardInput& input) noexcept {
  const auto* sample = std::get_if<SensorSample>(&input.what);
  return sample != nullptr ? std::get_if<ImageEvent>(sample) : nullptr;
}

[[nodiscard]] bool carriesInput(std::string_view channel);
[[nodiscard]] LogMessage encodeInput(const OnboardInput& input);
// std::nullopt for a channel that carries no input, or a message whose fingerprint, length or CRC is wrong.
[[nodiscard]] std::optional<OnboardInput> decodeInput(std::string_view channel,
                                                      std::span<const std::uint8_t> data);

// Reads a mission's inputs in recorded order; where there is no log, those of the RAW.auv. Damaged entries
// are skipped and counted. Throws InputError if the file is absent, empty, holds no sample at all, or cannot
// be read to its end.
[[nodiscard]] std::vector<OnboardInput> readOnboardInputs(const std::filesystem::path& mission_folder,
                                                          std::uint64_t& damaged);

}  // namespace fathom::io
