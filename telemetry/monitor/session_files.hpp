#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "realtime/base/files/descriptor.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

// A monitor's files of reception in a folder: received.bin, every accepted link frame as it arrived
// (packets.bin's format, read back after a restart), and frames.log, one line a frame. When the disk refuses,
// up to kMostWaiting bytes wait in memory and are written when there is room; trouble() says what is not
// stored.
class SessionFiles {
 public:
  // Creates the folder and opens both logs at their ends. Throws InputError if that fails.
  explicit SessionFiles(std::filesystem::path folder);
  ~SessionFiles();

  // Passes every frame of an earlier run's received.bin to `take`, which returns its verdict; returns the
  // number of whole frames. Skips damage and calls `on_damage` before the next frame; cuts off a damaged end.
  // `damage` becomes a sentence about it.
  using Take = std::function<telemetry::FrameVerdict(std::span<const std::uint8_t>, std::int64_t)>;
  std::size_t reload(const Take& take, const std::function<void()>& on_damage, std::string& damage);
  // Also keeps accepted frames in received.bin, unless `recorded`. frames.log gets `utc_ns verdict type
  // vehicle dive sequence bytes`; "-" for what a rejected frame lacks. Rejected frames beyond
  // kMaxRejectedLines are not logged, so that noise on the port cannot fill the disk.
  void log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes, std::int64_t utc_ns,
           bool recorded);
  // Writes and synchronises all that was received, so that it survives a power cut; false: some is not stored
  // and must not be acknowledged.
  [[nodiscard]] bool keep();
  // What cannot be stored now, a sentence; "": nothing.
  [[nodiscard]] std::string trouble() const;

 private:
  void write();

  static constexpr std::size_t kMostWaiting = std::size_t{16} << 20;  // [B]: a dive over a modem
  static constexpr std::uint64_t kMaxRejectedLines = 100'000;
  std::filesystem::path folder_;
  std::ofstream log_;
  Descriptor received_;
  std::vector<std::uint8_t> waiting_;  // bytes of received.bin that are not written yet
  bool synced_ = true;
  std::uint64_t lost_ = 0;  // frames for which there was no room in waiting_
  std::string received_trouble_;
  std::uint64_t rejected_lines_ = 0;
};

}  // namespace fathom::monitor
