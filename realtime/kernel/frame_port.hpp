#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace fathom {

// Sends and receives whole frames of an acoustic modem. Frames may be lost, repeated, reordered or damaged in
// transit; a port never splits or joins them. The drivers (serial, UDP) are in firmware_if, the simulated
// acoustic channel is in sim, and telemetry's protocol runs over any of them.
class FramePort {
 public:
  static constexpr std::size_t kMaxFrameBytes = 2048;  // of what acoustic modems take at once

  virtual ~FramePort() = default;

  // Hands one frame (1 to kMaxFrameBytes bytes) over for sending. Never blocks; false when the device refuses
  // it.
  [[nodiscard]] virtual bool send(std::span<const std::uint8_t> frame) noexcept = 0;

  // Copies the next received frame into `buffer` (at least kMaxFrameBytes) and returns its size; 0 when none
  // is waiting. Never blocks. Longer or broken frames are dropped and counted.
  [[nodiscard]] virtual std::size_t receive(std::span<std::uint8_t> buffer) noexcept = 0;

  // The frame that receive() gave last was authentic: a port without a fixed peer sends to its sender from
  // now on.
  virtual void answerLastSender() noexcept {}

  // Frames dropped on reception because they were too long or broken in the line protocol.
  [[nodiscard]] virtual std::uint64_t droppedFrames() const noexcept = 0;

  // Whether the device is present; while it is not, nothing is sent or received. On the thread that uses the
  // port.
  [[nodiscard]] virtual bool isOpen() const noexcept { return true; }
  // Why it is not; "" while it is. Valid until the next call.
  [[nodiscard]] virtual std::string_view reason() const noexcept { return {}; }
};

}  // namespace fathom
