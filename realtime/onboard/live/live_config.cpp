#include "realtime/onboard/live/live_config.hpp"

#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/predive/predive_checks.hpp"

namespace fathom::onboard {
namespace {

rt::OverloadConfig readOverload(const ConfigTable& t) {
  rt::OverloadConfig c;
  const auto whole = [&](const char* key, int fallback, int min, int max) {
    return static_cast<int>(t.integer(key, fallback, min, max));
  };
  c.raise_at = t.number("raise_at", c.raise_at, 0.1, 10);
  c.lower_at = t.number("lower_at", c.lower_at, 0.01, c.raise_at);
  c.raise_after = whole("raise_after", c.raise_after, 1, 100);
  c.lower_after = whole("lower_after", c.lower_after, 1, 1000);
  c.waiting_limit = whole("waiting_limit", c.waiting_limit, 1, 100);
  c.drop_waiting = whole("drop_waiting", c.drop_waiting, c.waiting_limit, 100);
  return c;
}

}  // namespace

LiveConfig readLiveConfig(const ConfigTable& root, const io::MissionConfig& mission) {
  LiveConfig c;
  c.cameras = io::readCameraConfig(root.table("cameras"), mission, c.cameras);
  c.dvl = io::readDvlConfig(root.table("dvl"), c.dvl);
  c.can = io::readCanConfig(root.table("can"), c.can);
  c.can.samples.latitude = mission.origin.latitude;
  c.lcm = io::readLcmConfig(root.table("lcm"), c.lcm);
  c.modem = io::readDeviceAddress(root.table("modem"), "device", "", false);
  // What `fathom-sensors predive` reads of the same file; checked here so that it may stand in it.
  (void)io::readPrediveConfig(root.table("predive"));
  c.recorder = io::readRecorderConfig(root.table("recorder"), c.recorder);
  c.realtime = rt::readRealtimeConfig(root.table("realtime"), c.realtime);
  const ConfigTable memory = root.table("memory");
  c.memory = rt::readMemoryConfig(memory, c.memory);
  c.vehicle_heap_bytes = static_cast<std::size_t>(memory.integer("vehicle_heap_mib", 24, 4, 4096)) << 20;
  c.overload = readOverload(root.table("overload"));
  const ConfigTable restart = root.table("restart");
  c.checkpoint_s = restart.number("checkpoint_s", c.checkpoint_s, 1, 600);
  const std::int64_t mib =
      restart.integer("buffer_mib", static_cast<std::int64_t>(c.checkpoint_bytes >> 20), 1, 4096);
  c.checkpoint_bytes = static_cast<std::size_t>(mib) << 20;
  c.end_within_s = root.table("realtime").number("end_within_s", c.end_within_s, 5, 3600);
  return c;
}

}  // namespace fathom::onboard
