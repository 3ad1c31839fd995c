#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::sim {

// What can go wrong with the devices of a bench run. The comment says what is done, and what one count is.
enum class FaultKind : std::uint8_t {
  kLostPackets,    // packets of an image never come: exposures that arrive incomplete
  kLostFrames,     // the camera exposes, its number goes on, nothing is sent: exposures not sent
  kSkew,           // the camera exposes late: exposures that are late
  kIdWrap,         // the camera's frame number jumps close to 65535 and wraps: wraps
  kCameraReboot,   // the camera goes away; its clock and its numbers begin anew: reboots
  kCanBusOff,      // the bus is down (or, over LCM, silent): times that it went down
  kDvlGarbage,     // a byte of the ensemble is damaged, noise before it: ensembles damaged
  kDvlSilence,     // the line is silent: ensembles withheld
  kModemSilence,   // neither end hears the other: times
  kDiskFull,       // the recording's file system is filled up: times
  kCpuHog,         // threads that never sleep: times
  kClockStep,      // the system's clock is set: steps, back included
  kMapperKilled,   // the mapper process dies (SIGKILL): times
  kMapperStopped,  // it gets no further (SIGSTOP): times
  kVehicleKilled,  // the whole program dies, and is started again: times
  kVehicleStopped  // the vehicle process gets no further: times
};
constexpr std::size_t kFaultKinds = 16;
// "lost_packets", "lost_frames"...: the word in the file.
[[nodiscard]] std::string_view nameOf(FaultKind kind);

struct Fault {
  FaultKind kind = FaultKind::kLostPackets;
  double at_s = 0;   // begin, in seconds of the mission since its first played moment
  double for_s = 0;  // duration [s]
  // Of camera faults: which.
  bool left = false, right = false;
  // Of lost_packets, lost_frames, dvl_garbage: of the exposures or ensembles in its time, counted from 0,
  // those whose number this divides are hit.
  int every = 1;
  int packets = 1;         // lost_packets: of each exposure hit
  bool resend = false;     // lost_packets: the camera sends them again when it is asked to
  double offset_s = 0.05;  // skew: how late
  int frame_id = 65530;    // id_wrap: number of the next exposure
  int noise_bytes = 40;    // dvl_garbage: before each ensemble hit
  double leave_mib = 0;    // disk_full: what stays free
  int threads = 1;         // cpu_hog
  double step_s = 3600;    // clock_step: forward, negative back; after a for_s > 0 it is taken back

  [[nodiscard]] bool covers(double mission_s) const { return mission_s >= at_s && mission_s < at_s + for_s; }
  [[nodiscard]] bool hits(CameraSide side) const { return side == CameraSide::kLeft ? left : right; }
};

// The moments at which the devices speak without faults, in mission seconds, each in rising order.
struct PlayedTimes {
  std::vector<double> left_s, right_s;  // exposures
  std::vector<double> dvl_s;            // ensembles
};

struct FaultScript {
  std::vector<Fault> faults;  // by begin

  // The fault of this kind that this camera has at this time; nullptr for none.
  [[nodiscard]] const Fault* camera(FaultKind kind, CameraSide side, double mission_s) const;
  // The fault of this kind (no camera's) at this time; nullptr for none.
  [[nodiscard]] const Fault* at(FaultKind kind, double mission_s) const;
  // What the script injects, by kind, in that kind's unit, where the devices speak at these times. Faults
  // that begin after the last of them are not counted.
  [[nodiscard]] std::array<std::uint64_t, kFaultKinds> expectedCounts(const PlayedTimes& times) const;
};

// A TOML file of [[fault]] tables, each with kind, at_s, for_s and the kind's own keys (sim/hil/README.md
// lists them). Throws InputError with file, line and fix for an unknown key, a value out of range, a key of
// another kind, or two faults at the same time on the same device, whose counts nobody could tell apart.
[[nodiscard]] FaultScript readFaultScript(const std::filesystem::path& path);
// The same from text; `name` stands for the file in error lines.
[[nodiscard]] FaultScript parseFaultScript(std::string_view text, const std::string& name);

}  // namespace fathom::sim
