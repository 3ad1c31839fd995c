#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>

#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::test {

// The vehicle's time in these dives runs so much faster.
inline constexpr double kRate = 2;
// [realtime] stuck_after_s of them, in seconds of the machine.
inline constexpr double kStuckAfter_s = 1.5;
// A camera's thread may be away for so long, looking for it, of the machine.
inline constexpr double kCameraAway_s = 10 / kRate;

// What the judge and the vehicle process share, over all lives of the vehicle.
struct VehicleSeen {
  // By the judge.
  rt::VehicleClock::Setting clock;
  std::atomic<bool> end{false};  // the dive is to end
  // By the vehicle. Added to the mission's times gives the vehicle's: it begins when the first life is armed.
  std::atomic<std::int64_t> shift_ns{0};
  std::atomic<std::uint64_t> lives{0};          // that were armed
  std::atomic<std::int64_t> armed_utc_ns{0};    // of the newest life
  std::atomic<std::uint64_t> beats{0};          // of navigation, as it goes
  std::atomic<std::uint32_t> phase{0};          // of the mapper
  std::atomic<std::int32_t> mapper{0};          // its process
  std::atomic<std::uint64_t> mapper_starts{0};  // of the newest life
  std::atomic<std::uint64_t> pairs{0};          // mapped or left out
  std::atomic<std::int64_t> lag_ns{0};
  std::atomic<std::uint64_t> wild_poses{0};  // not finite, or that jumped
  // When the dive has ended.
  std::atomic<bool> ended{false}, mapped{false};
  std::atomic<double> end_s{0};
  std::atomic<double> skipped_s{0};  // that navigation's cycles came too late, of the newest life [s]
};

struct VehiclePlaces {
  std::filesystem::path mission, out;
  [[nodiscard]] std::filesystem::path dive() const { return out / "dive"; }
  [[nodiscard]] std::filesystem::path config() const { return out / "dive.toml"; }
  [[nodiscard]] std::filesystem::path seen() const { return out / "seen"; }
  [[nodiscard]] std::filesystem::path parts() const { return out / "bad-parts"; }
};
// mission.toml and stereo.calib of the dive, and its configuration.
void prepareDive(const VehiclePlaces& places);

// The vehicle process of one life: LiveSystem with devices played from the mission, as fathom-onboard has it,
// until VehicleSeen::end. Exit status.
int runVehicle(const VehiclePlaces& places);

}  // namespace fathom::test
