#pragma once

#include <sstream>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/recorder/recorder.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::test {

// A dive with inputs and pixels that follow from their numbers, so that any part of it that is found on a
// disk can be checked: 100 inputs a second of every kind, one exposure of each camera every `inputs_per_pair`
// of them, raw bytes with each DVL ensemble.
class SyntheticDive {
 public:
  struct Config {
    int width = 320, height = 240;       // [px]
    std::uint64_t inputs_per_pair = 50;  // 2 Hz
  };
  static constexpr std::int64_t kStartUtcNs = 1'700'000'000'000'000'000;
  static constexpr std::int64_t kInputIntervalNs = 10'000'000;
  static constexpr std::uint64_t kRestartInputs = 100;  // inputs that pass while a recorder starts again

  explicit SyntheticDive(const Config& config) : config_(config) {}

  [[nodiscard]] io::MissionConfig mission() const;
  [[nodiscard]] StereoRig rig() const;
  [[nodiscard]] io::OnboardInput input(std::uint64_t number) const;
  [[nodiscard]] std::vector<std::uint16_t> pixels(const ImageEvent& image) const;

  // The inputs' numbers continue over restarts, as the vehicle's clock does. Checks that the log of
  // `folder` holds a run of consecutive inputs from number 0 (or several runs, when a restart left inputs
  // out), each as it was offered, that each exposure's file is there and right to the pixel unless the log
  // says that it is lost, and that no half of an image is left when `closed`.
  struct Found {
    std::vector<std::string> wrong;  // what is not as it should be
    std::uint64_t inputs = 0;        // in the log
    std::uint64_t next = 0;          // number behind the last input
    std::uint64_t skipped = 0;       // numbers left out between runs
    std::uint64_t images = 0, images_lost = 0;
  };
  [[nodiscard]] Found check(const std::filesystem::path& folder) const;

 private:
  Config config_;
};

// The cameras' blocks, and the dive offered to a recorder input by input, as the onboard program does it.
class DivePlayer {
 public:
  DivePlayer(const SyntheticDive& dive, const SyntheticDive::Config& config, std::size_t blocks);

  [[nodiscard]] io::Recorder::ViewOf viewOf();
  [[nodiscard]] io::Recorder::Release release();
  // Offers input `number`, its image and its raw bytes first. False when the input was refused.
  bool offer(io::Recorder& recorder, std::uint64_t number);

  [[nodiscard]] const rt::SharedBlocks& blocks() const { return blocks_; }
  [[nodiscard]] std::uint64_t withoutBlock() const { return without_block_; }

 private:
  const SyntheticDive& dive_;
  SyntheticDive::Config config_;
  rt::SharedBlocks blocks_;
  std::uint64_t without_block_ = 0;  // exposures that found every block held
};

// The lines of dive_recorder: what had been offered, and what was safe, at which time.
struct RecorderStatus {
  struct Line {
    std::int64_t time_ms = 0;
    std::uint64_t offered = 0, safe = 0;  // numbers behind the last input
  };
  std::vector<Line> lines;

  explicit RecorderStatus(const std::string& text) {
    std::istringstream in(text);
    std::string line;
    while (std::getline(in, line)) {
      // A line without its end was cut with the recorder.
      Line read;
      std::istringstream words(line);
      if (!in.eof() && words >> read.time_ms >> read.offered >> read.safe) lines.push_back(read);
    }
  }

  [[nodiscard]] std::uint64_t safe() const { return lines.empty() ? 0 : lines.back().safe; }
  [[nodiscard]] std::uint64_t offered() const { return lines.empty() ? 0 : lines.back().offered; }
  // What had been offered `age_ms` before the last line.
  [[nodiscard]] std::uint64_t offeredBefore(std::int64_t age_ms) const {
    std::uint64_t offered = 0;
    for (const Line& line : lines)
      if (line.time_ms <= lines.back().time_ms - age_ms) offered = line.offered;
    return offered;
  }
  // Age at the last line of the oldest input behind number `found`, at most: it was offered after the line
  // before; 0 when there is none [ms].
  [[nodiscard]] std::int64_t lostMs(std::uint64_t found) const {
    if (offered() <= found) return 0;
    std::int64_t there_ms = lines.front().time_ms;
    for (const Line& line : lines)
      if (line.offered <= found) there_ms = line.time_ms;
    return lines.back().time_ms - there_ms;
  }
};

}  // namespace fathom::test
