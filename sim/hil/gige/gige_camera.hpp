#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "recon/geometry/image_view.hpp"
#include "sim/hil/gige/gige_schedule.hpp"

namespace fathom::sim {

struct GigeCameraOptions {
  std::string interface = "127.0.0.1";  // address to serve on; one camera an address
  std::string serial = "FTH-L";
  std::filesystem::path images;  // folder of the schedule's files
  PixelFormat format = PixelFormat::kMono;
  int bits = 12;
  std::int64_t start_utc_ns = 0;  // system's time of mission second 0
  double rate = 1;                // mission seconds a second
  double clock_ppm = 0;           // that the camera's clock is fast
  double clock_offset_s = 0;      // what it shows when the program starts
  int frame_id_start = 1;
  std::uint64_t seed = 1;       // which packets are lost
  std::filesystem::path log;    // what became of each exposure; empty: none
  bool exit_when_done = false;  // after the last exposure
};

// A GigE Vision camera that plays images: a GVCP and GVSP server (registers, GenICam description, discovery,
// heartbeat, resends, time stamp latch, test packet, IEEE 1588 stamps) on one address, with a clock of its
// own.
//
// It exposes at the schedule's moments whatever frame rate or trigger is set: the schedule stands for both.
// Exposures are tied to the monotonic clock once, at the start, so that a step of the system's clock moves
// none. A frame is sent an exposure time after its stamp, while a client has started the acquisition.
//
// Aravis' own simulated camera is not used for this: it paces by the system's clock in whole periods, and has
// no resends, no latch, no chosen losses and no restart.
//
// The log has a line an exposure: number, mission_s, file, frame_id, device_ns, exposed_utc_ns, fate (sent,
// idle, lost, away), packets, packets_lost, late_s. Throws InputError for an address that cannot be served or
// an image that cannot be read. Returns when `stop` is set, or after the last exposure when the options say
// so. `ready` is called once it serves.
void serveGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule,
                     const std::atomic<bool>& stop, const std::function<void()>& ready);

}  // namespace fathom::sim
