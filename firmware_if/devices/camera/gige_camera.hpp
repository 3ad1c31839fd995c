#pragma once

#include <memory>
#include <string>

#include "firmware_if/devices/camera/camera_config.hpp"
#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/kernel/memory/arena.hpp"

namespace fathom::io {

// A GigE Vision camera by Aravis. A frame goes: packets -> one of `buffers` registered buffers (Aravis' own
// receiving thread) -> unpacked into a block of the pool (the thread that polls), the buffer given back at
// once.
//
// Only frames that came whole, with the size and format that were asked, are given out; each other outcome
// has a counter in health():
//   incomplete      packets missing in the end, after they were asked for again
//   timed_out       the frame was given up before all of it came
//   wrong_size      another width, height or number of bytes
//   wrong_format    another pixel format, or no image
//   missed          ids that never came at all
//   id_jumps        ids that do not follow from the one before
//   stale           an exposure again, or one older than the newest
//   pool_full       a whole frame for which no block was free: the newest is dropped
//   no_buffer       packets for which Aravis had no buffer, the polling thread being late
//   resent_packets  asked for again and come
//   clock_resets    the camera's clock leapt
//   clock_unsettled frames before the camera's clock was known well enough to pair them
//   clock_held      mapped times held back to keep their order
//   ptp_apart       stamps that were not the time of day though PTP is asked
//   control_lost    the camera no longer answers the heartbeat, or started again
//   stalled         no frame for longer than kSilentPeriods
//   no_first_frame  a camera that runs free answered but never began, and was opened again
//   open_failed     attempts to open it that failed
//   priority_refused  1: the receiving thread did not get its priority
//   receive_buffer_small  times that it was opened with less room than a frame's packets need
// A camera that is lost is closed, and looked for at most once a second; what it gives then continues the
// ids.
class GigeCamera final : public CameraSource {
 public:
  // Takes all memory of the frames here; opens nothing. Throws std::system_error when the memory is refused.
  // `clock`: for stamps by IEEE 1588, which are UTC.
  GigeCamera(const CameraConfig& config, VehicleTime now, VehicleClockState clock = {},
             rt::MemoryLock lock = rt::MemoryLock::kUnlocked);
  ~GigeCamera() override;
  GigeCamera(const GigeCamera&) = delete;
  GigeCamera& operator=(const GigeCamera&) = delete;

  // While there is no camera, a call takes the time of a search (about a second and a half) beyond its
  // timeout.
  bool poll(int timeout_ms, FrameSink& sink) override;
  void close() noexcept override;
  [[nodiscard]] rt::SharedBlocks& pool() noexcept override;
  [[nodiscard]] ImageView view(const CameraFrame& frame) noexcept override;
  [[nodiscard]] DeviceHealth health() const override;

  // On the polling thread: why the last attempt to open failed, empty when it did not; and what the open
  // camera says of itself.
  [[nodiscard]] const std::string& lastFailure() const noexcept;
  [[nodiscard]] std::string serial() const;
  [[nodiscard]] std::string address() const;
  [[nodiscard]] int packetSize() const noexcept;     // [bytes]
  [[nodiscard]] double clockDrift() const noexcept;  // of the camera's clock against the vehicle's [s/s]
  // Bytes that frames and buffers take.
  [[nodiscard]] static std::size_t memoryBytes(const CameraConfig& config);

  // Periods of silence, at least two seconds, after which a camera that has sent is closed and opened again.
  // One that has not sent since it was opened gets three seconds more, and twice as long each time
  // (FirstFrameWait); a camera on a trigger line is left alone while it answers: its trigger may not run yet.
  static constexpr double kSilentPeriods = 6;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::io
