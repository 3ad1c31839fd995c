#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

// What a monitor leaves behind of reception in a folder: received.bin, every accepted link frame as it
// arrived (packets.bin's format, so that a computer that was off goes on where it was), and frames.log, one
// line a frame. A disk that refuses ends nothing: what it has not taken waits, as much as kMostWaiting, and
// goes when there is room; trouble() says what is not kept.
class SessionFiles {
 public:
  // Creates the folder and opens both logs at their ends. Throws InputError if that cannot be.
  explicit SessionFiles(std::filesystem::path folder);
  ~SessionFiles();
  SessionFiles(const SessionFiles&) = delete;
  SessionFiles& operator=(const SessionFiles&) = delete;

  // Gives every frame of received.bin, of an earlier run, to `take`, which says what became of it; returns
  // how many were whole. What is damaged is passed over, `on_damage` called there, before the frame that
  // follows; a damaged end is cut off. `damage` says so.
  using Take = std::function<telemetry::FrameVerdict(std::span<const std::uint8_t>, std::int64_t)>;
  std::size_t reload(const Take& take, const std::function<void()>& on_damage, std::string& damage);
  // Also keeps accepted frames in received.bin, unless `recorded`. frames.log gets `utc_ns verdict type
  // vehicle dive sequence bytes`; "-" for what a rejected frame does not tell. Rejected frames beyond
  // kMaxRejectedLines are not logged, so that noise on the port cannot fill the disk.
  void log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes, std::int64_t utc_ns,
           bool recorded);
  // Puts all that was received on the disk itself, so that it survives a power cut; false: some is not there,
  // and must not be acknowledged.
  [[nodiscard]] bool keep();
  // What cannot be kept now, a sentence; "" for nothing.
  [[nodiscard]] std::string trouble() const;

 private:
  void write();

  static constexpr std::size_t kMostWaiting = std::size_t{16} << 20;  // [B]: a dive over a modem
  static constexpr std::uint64_t kMaxRejectedLines = 100'000;
  std::filesystem::path folder_;
  std::ofstream log_;
  int received_ = -1;                  // file descriptor
  std::vector<std::uint8_t> waiting_;  // of received.bin, that the disk has not taken
  bool synced_ = true;
  std::uint64_t lost_ = 0;  // frames for which there was no room to wait
  std::string received_trouble_;
  std::uint64_t rejected_lines_ = 0;
};

}  // namespace fathom::monitor
