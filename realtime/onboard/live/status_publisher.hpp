#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include "firmware_if/devices/lcm/health_report.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "realtime/kernel/health/system_status.hpp"
#include "realtime/kernel/memory/memory_budget.hpp"
#include "realtime/onboard/live/live_system.hpp"
#include "recon/geometry/geodesy.hpp"

namespace fathom::onboard {

// Publishes pose, map, link and health of the vehicle on the bus and in the log. One best-effort thread calls
// step(); it reads what the tiers and the mapper left and delays none of them. A pose is published only while
// the position of odometry in nav is known: from the first fix on; while no mapper runs, by the last known
// one.
class StatusPublisher {
 public:
  struct Config {
    double pose_hz = 1;    // 0: no poses
    std::size_t lane = 0;  // of the recorder
  };
  // `bus`: null where the vehicle has none; the log has the messages all the same.
  StatusPublisher(LiveSystem& live, std::shared_ptr<io::LcmBus> bus, const io::MissionConfig& mission,
                  const std::filesystem::path& folder, const Config& config, const rt::VehicleClock& clock);

  void step();
  // Until the next step [ns].
  [[nodiscard]] std::int64_t restNs() const;
  // The newest pose in nav, for other outputs; std::nullopt before one is known.
  [[nodiscard]] const std::optional<io::PoseReport>& pose() const { return pose_; }
  [[nodiscard]] const MapState& map() const { return map_; }

 private:
  void publishPose();
  void setOwnStatus();
  void publishSlow();
  void logPassedOver();
  [[nodiscard]] io::HealthReport health();
  [[nodiscard]] io::MapReport mapReport() const;
  [[nodiscard]] io::LinkReport linkReport() const;
  void publish(const io::LogMessage& message);
  // False where the recorder has no room for it.
  bool log(const io::LogMessage& message);

  LiveSystem& live_;
  std::unique_ptr<io::LcmPublisher> publisher_;
  LocalTransverseMercator local_;
  Config config_;
  double root_size_;
  int max_level_;
  const rt::VehicleClock& clock_;
  rt::SystemStatus system_;
  rt::ProcessMemory process_;
  NavState nav_;
  MapState map_;
  std::optional<io::PoseReport> pose_;
  std::uint64_t passed_over_reported_ = 0;  // inputs, of this mapper
  std::int64_t next_pose_ns_ = 0, next_slow_ns_ = 0, begin_ns_;
};

}  // namespace fathom::onboard
