#pragma once

#include <cstdint>
#include <string>

#include "firmware_if/devices/sample_source.hpp"
#include "realtime/kernel/rings/shared_blocks.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::io {

// One whole exposure. Its pixels are in a block of the camera's pool, 8 bits in bytes, more in 16-bit words,
// rows without gaps: as readImage() gives the recorded file. Trivially copyable, so that it crosses rings.
struct CameraFrame {
  CameraSide side = CameraSide::kLeft;
  std::uint32_t block = rt::SharedBlocks::kNone;  // held once for the receiver, which releases it
  std::uint64_t frame_id = 0;                     // the device's, unwrapped: grows by one an exposure
  std::int64_t device_ns = 0;                     // the device's own time stamp
  std::int64_t utc_ns = 0;                        // of the exposure: device_ns mapped to UTC
  std::int64_t arrival_utc_ns = 0;  // when the thread that polls had it, right after its last packet
  double exposure_s = 0;
  double gain_db = 0;
};

class FrameSink {
 public:
  virtual ~FrameSink() = default;
  virtual void frame(const CameraFrame& frame) noexcept = 0;
};

// One camera. One thread polls it; a camera that is unplugged, rebooted or that stalls is found and started
// again by poll() itself. Only whole frames are ever given out.
class CameraSource {
 public:
  virtual ~CameraSource() = default;
  // Waits at most `timeout_ms`, then hands every whole frame that came to the sink. False when there is no
  // camera. May throw exceptions of the libraries that it uses: call it through PollGuard.
  virtual bool poll(int timeout_ms, FrameSink& sink) = 0;
  // Closes the camera; the next poll() opens it again. On the polling thread.
  virtual void close() noexcept {}
  [[nodiscard]] virtual rt::SharedBlocks& pool() noexcept = 0;
  // The pixels of a frame that the caller holds.
  [[nodiscard]] virtual ImageView view(const CameraFrame& frame) noexcept = 0;
  // Takes no memory. Only on the polling thread.
  [[nodiscard]] virtual DeviceHealth health() const = 0;
};

}  // namespace fathom::io
