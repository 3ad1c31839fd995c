#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "firmware_if/log/log_inputs.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::onboard {

// The log's inputs by position, one after the other: fresh ones from the ring in shared memory, what the ring
// has overrun from the file. What neither has is skipped, after a while in which the recorder may still write
// it, and counted.
class InputFeed {
 public:
  // `patience_ns`: that the recorder may take until the file has what memory no longer has.
  static constexpr std::int64_t kPatience_ns = 30'000'000'000;
  InputFeed(std::filesystem::path mission, const MapperDown& down, std::int64_t patience_ns = kPatience_ns);

  // Begins behind the mark of checkpoint `number`, whose position is `position`; 0, 0: at the log's
  // beginning. False where the file does not hold the mark.
  [[nodiscard]] bool begin(std::uint64_t number, std::uint64_t position);

  // The next input; false when there is none yet.
  [[nodiscard]] bool next(io::OnboardInput& input);
  // Of the input that next() gives.
  [[nodiscard]] std::uint64_t position() const { return position_; }
  // What the file says was decided about a pair, read so far or behind that.
  [[nodiscard]] std::optional<io::Decision> decisionOf(std::uint32_t pair) const;
  [[nodiscard]] std::uint64_t skipped() const { return skipped_; }
  // Of them, those that the log may have by now: the recorder was too slow for this feed's patience.
  [[nodiscard]] std::uint64_t passedOver() const { return passed_over_; }

 private:
  enum class OfFile : std::uint8_t { kGot, kMissing, kNotYet };
  [[nodiscard]] OfFile nextOfFile(io::OnboardInput& input);
  [[nodiscard]] bool giveUpWaiting();
  void note(const io::OnboardInput& input);

  std::filesystem::path mission_;
  const MapperDown& down_;
  std::int64_t patience_ns_;
  std::unique_ptr<io::LogInputReader> file_;
  std::map<std::uint32_t, io::Decision> decisions_;
  std::uint64_t position_ = 0, skipped_ = 0, passed_over_ = 0;
  std::int64_t waiting_since_ns_ = 0;  // monotonic; 0: not
};

}  // namespace fathom::onboard
