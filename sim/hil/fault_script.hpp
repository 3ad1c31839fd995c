#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::sim {

// Faults of the devices of a bench run. The comments give the effect, and the unit of the count.
enum class FaultKind : std::uint8_t {
  kLostPackets,    // packets of an image are not sent: exposures that arrive incomplete
  kLostFrames,     // the camera exposes and counts, but sends nothing: exposures not sent
  kSkew,           // the camera exposes late: late exposures
  kIdWrap,         // the camera's frame number jumps close to 65535 and wraps: wraps
  kCameraReboot,   // the camera restarts with its clock and its numbers reset: reboots
  kCanBusOff,      // the bus is down (or, over LCM, silent): occurrences
  kDvlGarbage,     // a byte of the ensemble is damaged, noise before it: ensembles damaged
  kDvlSilence,     // the line is silent: ensembles withheld
  kModemSilence,   // no frames in either direction: occurrences
  kDiskFull,       // the recording's file system is filled: occurrences
  kCpuHog,         // threads that never sleep: occurrences
  kClockStep,      // the system's clock is set: steps, including those back
  kMapperKilled,   // the mapper process is killed (SIGKILL): occurrences
  kMapperStopped,  // the mapper process is stopped (SIGSTOP): occurrences
  kVehicleKilled,  // the whole program is killed and restarted: occurrences
  kVehicleStopped  // the vehicle process is stopped: occurrences
};
constexpr std::size_t kFaultKinds = 16;
// "lost_packets", "lost_frames"...: the word in the file.
[[nodiscard]] std::string_view nameOf(FaultKind kind);

struct Fault {
  FaultKind kind = FaultKind::kLostPackets;
  double at_s = 0;   // begin, in seconds of the mission since its first played moment
  double for_s = 0;  // duration [s]
  // Cameras that a camera fault hits.
  bool left = false, right = false;
  // lost_packets, lost_frames, dvl_garbage: every n-th exposure or ensemble in its time is hit, from the
  // first.
  int every = 1;
  int packets = 1;         // lost_packets: of each exposure hit
  bool resend = false;     // lost_packets: the camera resends them on request
  double offset_s = 0.05;  // skew: how late
  int frame_id = 65530;    // id_wrap: number of the next exposure
  int noise_bytes = 40;    // dvl_garbage: before each ensemble hit
  double leave_mib = 0;    // disk_full: remaining free space
  int threads = 1;         // cpu_hog
  double step_s = 3600;    // clock_step: positive forward; undone after for_s > 0

  [[nodiscard]] bool covers(double mission_s) const { return mission_s >= at_s && mission_s < at_s + for_s; }
  [[nodiscard]] bool hits(CameraSide side) const { return side == CameraSide::kLeft ? left : right; }
};

// Times at which the devices send without faults, in mission seconds, each in rising order.
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
  // Counts that the script injects for these times, by kind, in that kind's unit. Faults that begin after the
  // last of them are not counted.
  [[nodiscard]] std::array<std::uint64_t, kFaultKinds> expectedCounts(const PlayedTimes& times) const;
};

// A TOML file of [[fault]] tables, each with kind, at_s, for_s and the kind's own keys (sim/hil/README.md
// lists them). Throws InputError with file, line and fix for an unknown key, a value out of range, a key of
// another kind, or overlapping faults on one device, with indistinguishable counts.
[[nodiscard]] FaultScript readFaultScript(const std::filesystem::path& path);
// The same from text; errors name `name` as the file.
[[nodiscard]] FaultScript parseFaultScript(std::string_view text, const std::string& name);

}  // namespace fathom::sim
