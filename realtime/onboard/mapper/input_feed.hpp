#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "firmware_if/mission/log/log_inputs.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"

namespace fathom::onboard {

// The log's inputs in order of position: new ones from the ring in shared memory, those that the ring has
// overwritten from the file. Inputs that neither has are skipped and counted, after a time in which the
// recorder may still write them.
class InputFeed {
 public:
  // `patience_ns`: time for the recorder to write inputs that the ring has overwritten.
  static constexpr std::int64_t kPatience_ns = 30'000'000'000;
  InputFeed(std::filesystem::path mission, const MapperDown& down, std::int64_t patience_ns = kPatience_ns);

  // Begins after the mark of checkpoint `number`, at `position`; 0, 0: at the log's beginning. False if the
  // file does not hold the mark.
  [[nodiscard]] bool begin(std::uint64_t number, std::uint64_t position);

  // The next input; false when there is none yet.
  [[nodiscard]] bool next(io::OnboardInput& input);
  // Of the input that next() gives.
  [[nodiscard]] std::uint64_t position() const { return position_; }
  // Logged decision about a pair, in the part read so far or after it.
  [[nodiscard]] std::optional<io::Decision> decisionOf(std::uint32_t pair) const;
  [[nodiscard]] std::uint64_t skipped() const { return skipped_; }
  // Part of skipped() that the log may have by now: the recorder took longer than the patience.
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
