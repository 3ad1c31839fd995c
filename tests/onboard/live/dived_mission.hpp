#pragma once

#include <functional>
#include <memory>

#include "tests/onboard/live/dive_files.hpp"
#include "tests/onboard/live/played_devices.hpp"

namespace fathom::test {

// The part of a recorded dive in which the seafloor is in sight, played four times as fast to live systems
// that come one after the other, as after crashes, in one vehicle's time.
class DivedMission {
 public:
  static constexpr double kRate = 4;
  static constexpr double kLead_s = 4;  // until the seafloor comes: the program must be armed by then

  explicit DivedMission(std::filesystem::path mission);

  // The system that dives in `folder`, its devices where the mission is now.
  [[nodiscard]] std::unique_ptr<onboard::LiveSystem> start(const std::filesystem::path& folder,
                                                           bool clear_folder, const std::string& more = "",
                                                           double stuck_after_s = 30);
  // Supervises until `done`, or `most_s` of the vehicle's time have passed: whether it came true. What the
  // supervisor says goes to said().
  bool superviseUntil(onboard::LiveSystem& live, const std::function<bool()>& done, double most_s);
  void supervise(onboard::LiveSystem& live, double seconds) {
    (void)superviseUntil(
        live, [] { return false; }, seconds);
  }
  [[nodiscard]] double leftSeconds() const;
  [[nodiscard]] const std::vector<std::string>& said() const { return said_; }
  [[nodiscard]] bool saidThat(const std::string& what) const;

 private:
  std::filesystem::path mission_;
  rt::VehicleClock clock_;
  PlayedMission played_;
  std::vector<std::string> said_;
};

// What the mapper last showed.
[[nodiscard]] inline onboard::MapState mapOf(const onboard::LiveSystem& live) {
  onboard::MapState map;
  (void)live.mapper().up().readMap(map);
  return map;
}
[[nodiscard]] inline onboard::MapperPhase phaseOf(const onboard::LiveSystem& live) {
  return live.mapper().up().current();
}
// Files of onboard/ in which the dive and a replay of its recording differ, with its configuration.
[[nodiscard]] inline std::vector<std::string> replayDifferences(const std::filesystem::path& folder) {
  return replayDifferences(folder, folder.string() + ".toml", folder / "again");
}

}  // namespace fathom::test
