#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "firmware_if/devices/camera/pixel_unpack.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/base/config_keys.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

inline constexpr std::array<const char*, 2> kCameraSides = {"left", "right"};  // by CameraSide

enum class CameraTrigger : std::uint8_t {
  kFreeRun,  // at rate_hz, each camera by its own clock
  kLine,     // an edge on an input line exposes
  kPtp,      // at rate_hz, the cameras' clocks set by IEEE 1588
};

// One camera, as it is set up each time that it is found.
struct CameraConfig {
  CameraSide side = CameraSide::kLeft;
  std::string id;  // serial number, "Vendor-serial", the name stored in the camera, or an IP address
  WireFormat format;
  int width = 1360, height = 1024;   // [px]
  double exposure_us = 0;            // 0: as the camera has it
  double gain_db = -1;               // below 0: as the camera has it
  int packet_size = 0;               // [bytes], 0: the largest that the network carries
  std::int64_t packet_delay_ns = 0;  // between packets, so that two cameras share a switch
  CameraTrigger trigger = CameraTrigger::kFreeRun;
  std::string trigger_line = "Line1";
  std::string trigger_activation = "RisingEdge";
  double rate_hz = 2;
  std::size_t buffers = 4;        // that the driver fills
  std::size_t pool_frames = 9;    // whole frames that map and recorder may hold
  std::string interface;          // network interface to look on; empty: all
  bool packet_socket = false;     // receive below the UDP stack; only where no other camera sends
  int receive_priority = 0;       // SCHED_FIFO of the receiving thread, 0: ordinary
  double stamp_to_packet_ms = 0;  // known part of the time from stamp to first packet [ms]
};

struct StereoCameraConfig {
  std::array<CameraConfig, 2> side;  // by CameraSide
  [[nodiscard]] bool used() const { return !side[0].id.empty() || !side[1].id.empty(); }
};

// The keys of [cameras]. A reader's formats and rate default to what the mission says: the 12-bit packed form
// of its pixels, or 8 bits.
void visitCameras(KeyVisitor& keys, StereoCameraConfig& config, const MissionConfig& mission);

// Compares the cameras' own serial numbers `left` and `right` with those of the mission's calibration: one
// line that says what differs, a swapped pair by that name; empty when they match.
[[nodiscard]] std::string serialMismatch(const MissionConfig& mission, const std::string& left,
                                         const std::string& right);

}  // namespace fathom::io
