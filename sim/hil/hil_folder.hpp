#pragma once

#include <filesystem>
#include <string>

#include "sim/hil/hil_run.hpp"
#include "sim/hil/mission_schedule.hpp"

namespace fathom::sim {

// RUN, the folder of one bench run:
//
//   mission/              mission.toml and stereo.calib for the vehicle, then its recording and onboard/
//   onboard.toml          the configuration given, and the devices of the bench
//   dvl, modem            the program's serial ports (while it runs)
//   camera-left.txt, .csv, .log and -right   what each camera plays, results of its exposures, its output
//   onboard.log           output of the program under test
//   heard.bin             frames as the ship received them, for fathom-monitor --packets
//   replay/, direct/      onboard/ of the recording replayed, and of the mission replayed directly
//   hil.json              what was played and injected; compare.json: results of the checks
struct HilFolder {
  explicit HilFolder(std::filesystem::path run) : root(std::move(run)) {}
  std::filesystem::path root;
  [[nodiscard]] std::filesystem::path mission() const { return root / "mission"; }
  [[nodiscard]] std::filesystem::path config() const { return root / "onboard.toml"; }
  [[nodiscard]] std::filesystem::path dvl() const { return root / "dvl"; }
  [[nodiscard]] std::filesystem::path modem() const { return root / "modem"; }
  [[nodiscard]] std::filesystem::path camera(CameraSide side, const std::string& extension) const {
    return root / ((side == CameraSide::kLeft ? "camera-left." : "camera-right.") + extension);
  }
  [[nodiscard]] std::filesystem::path onboardLog() const { return root / "onboard.log"; }
  [[nodiscard]] std::filesystem::path receivedFrames() const { return root / "heard.bin"; }
  [[nodiscard]] std::filesystem::path clockStep() const { return root / "clock_step"; }
  [[nodiscard]] std::filesystem::path replay() const { return root / "replay"; }
  [[nodiscard]] std::filesystem::path direct() const { return root / "direct"; }
  [[nodiscard]] std::filesystem::path report() const { return root / "hil.json"; }
  [[nodiscard]] std::filesystem::path comparison() const { return root / "compare.json"; }
};

// Addresses of the vehicle's devices on this bench.
struct HilDevices {
  std::string left, right;      // camera ids
  std::string dvl, modem, lcm;  // addresses; empty: none
  double dvl_latency_s = 0;
};

// Creates RUN. Throws InputError for a folder with other content, and for an earlier run without `force`.
void makeHilFolder(const HilFolder& folder, bool force);
// Writes mission/ and the cameras' schedules, before the program starts.
void writeHilMission(const HilFolder& folder, const MissionSchedule& schedule);
// onboard.toml: the base, then the devices. Throws InputError for a base that cannot be read.
void writeHilConfig(const HilFolder& folder, const MissionSchedule& schedule, const HilOptions& options,
                    const HilDevices& devices);

}  // namespace fathom::sim
