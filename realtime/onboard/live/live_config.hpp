#pragma once

#include <cstddef>
#include <string>

#include "firmware_if/devices/camera/camera_config.hpp"
#include "firmware_if/devices/can/bus/can_source.hpp"
#include "firmware_if/devices/dvl/dvl_source.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/predive/predive_checks.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/kernel/memory/heap_reserve.hpp"
#include "realtime/kernel/threads/overload_rule.hpp"
#include "realtime/kernel/threads/realtime_config.hpp"

namespace fathom::onboard {

// Settings of onboard.toml for a live run only: the devices, the recorder, real time and memory. A replay
// reads them too, so that the same file serves both, and ignores them.
struct LiveConfig {
  io::StereoCameraConfig cameras;
  io::DvlConfig dvl;
  io::CanConfig can;
  io::LcmConfig lcm;
  std::string modem;          // serial:DEVICE:BAUD or udp:HOST:PORT; empty: none
  io::PrediveConfig predive;  // of fathom-sensors predive, which reads the same file
  io::RecorderConfig recorder;
  rt::RealtimeConfig realtime;
  rt::MemoryConfig memory;
  rt::OverloadConfig overload;
  double checkpoint_s = 10;                               // between two saved states
  std::size_t checkpoint_bytes = std::size_t{112} << 20;  // that one may take
};

// Their tables.
void visitLive(KeyVisitor& keys, LiveConfig& config, const io::MissionConfig& mission);

}  // namespace fathom::onboard
