#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

// One exposure of a simulated camera with its faults.
struct GigeExposure {
  double mission_s = 0;  // since the begin of playing, without faults
  std::string file;      // of img/
  double late_s = 0;     // delay of the exposure
  bool lost = false;     // not sent
  int lost_packets = 0;  // number of lost packets
  bool resend = false;   // lost packets are sent on request
  int frame_id = 0;      // its number; 0: the next
  bool away = false;     // the camera is restarting
};

struct GigeReboot {
  double at_s = 0, for_s = 0;  // mission seconds
};

struct GigeSchedule {
  std::vector<GigeExposure> exposures;  // in rising order
  std::vector<GigeReboot> reboots;      // in rising order
};

// Exposures of one side from the image events of the mission's log; `first_utc_ns` is mission second 0,
// before which nothing is played. Throws InputError for a mission without images of this side.
[[nodiscard]] std::vector<GigeExposure> missionExposures(const std::filesystem::path& mission,
                                                         CameraSide side, std::int64_t first_utc_ns);
// The same from lines "<mission second>,<file of img/>", in rising order. Throws InputError naming the line.
[[nodiscard]] std::vector<GigeExposure> listedExposures(const std::filesystem::path& list);

// Adds the script's faults of this camera to the exposures.
[[nodiscard]] GigeSchedule withFaults(std::vector<GigeExposure> exposures, const FaultScript& script,
                                      CameraSide side);

struct GigeCameraOptions {
  std::string interface = "127.0.0.1";  // address to serve on; one camera for each address
  std::string serial = "FTH-L";
  std::filesystem::path images;  // folder of the schedule's files
  PixelFormat format = PixelFormat::kMono;
  int bits = 12;
  std::int64_t start_utc_ns = 0;  // system's time of mission second 0
  double rate = 1;                // mission seconds a second
  double clock_ppm = 0;           // that the camera's clock is fast
  double clock_offset_s = 0;      // its reading at the start
  int frame_id_start = 1;
  std::uint64_t seed = 1;       // of the choice of lost packets
  std::filesystem::path log;    // results of the exposures; empty: none
  bool exit_when_done = false;  // after the last exposure
};

// A GigE Vision camera that plays images: a GVCP and GVSP server (registers, GenICam description, discovery,
// heartbeat, resends, time stamp latch, test packet, IEEE 1588 stamps) on one address, with a clock of its
// own.
//
// It exposes at the schedule's times for any frame rate or trigger in the registers. The schedule is
// converted to the monotonic clock at the start, so that a step of the system's clock shifts no exposure. A
// frame is sent an exposure time after its stamp, while a client has started the acquisition. (Aravis'
// simulated camera sends in whole periods of the system's clock, without resends, latch, chosen losses and
// restarts.)
//
// The log has a line for each exposure: number, mission_s, file, frame_id, device_ns, exposed_utc_ns, fate
// (sent, idle, lost, away), packets, packets_lost, late_s. Throws InputError for an address that cannot be
// served or an image that cannot be read. Returns on `stop`, or after the last exposure with
// `exit_when_done`. `ready` is called once it serves.
void serveGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule,
                     const std::atomic<bool>& stop, const std::function<void()>& ready);

}  // namespace fathom::sim
