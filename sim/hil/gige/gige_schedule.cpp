#include "sim/hil/gige/gige_schedule.hpp"

#include <charconv>
#include <fstream>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::sim {

std::vector<GigeExposure> missionExposures(const std::filesystem::path& mission, CameraSide side,
                                           std::int64_t first_utc_ns) {
  std::vector<GigeExposure> exposures;
  io::SensorLogReader log(mission);
  while (const auto entry = log.next()) {
    const auto* event = std::get_if<ImageEvent>(&entry->sample);
    if (event == nullptr || event->side != side || event->utc_ns < first_utc_ns) continue;
    if (!io::plainFileName(event->file_name)) continue;
    const double mission_s = static_cast<double>(event->utc_ns - first_utc_ns) * 1e-9;
    if (!exposures.empty() && mission_s <= exposures.back().mission_s) continue;  // a camera exposes in order
    exposures.push_back({.mission_s = mission_s, .file = event->file_name});
  }
  if (exposures.empty())
    throw InputError(mission, side == CameraSide::kLeft ? "left images" : "right images",
                     "has none after the start; give a mission with images, or an earlier start");
  return exposures;
}

std::vector<GigeExposure> listedExposures(const std::filesystem::path& list) {
  std::ifstream in(list);
  if (!in) throw InputError(list, "", "cannot be read; give lines of <mission second>,<image file>");
  std::vector<GigeExposure> exposures;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::size_t comma = line.find(',');
    GigeExposure exposure;
    const char* end = line.data() + std::min(comma, line.size());
    const auto [stop, error] = std::from_chars(line.data(), end, exposure.mission_s);
    if (comma != std::string::npos) exposure.file = line.substr(comma + 1);
    if (error != std::errc() || stop != end || !(exposure.mission_s >= 0) ||
        !io::plainFileName(exposure.file) ||
        (!exposures.empty() && exposure.mission_s <= exposures.back().mission_s))
      throw InputError(list, "line " + std::to_string(number),
                       "is no <mission second>,<image file> later than the line before");
    exposures.push_back(std::move(exposure));
  }
  if (exposures.empty()) throw InputError(list, "", "is empty; give lines of <mission second>,<image file>");
  return exposures;
}

GigeSchedule withFaults(std::vector<GigeExposure> exposures, const FaultScript& script, CameraSide side) {
  GigeSchedule schedule{.exposures = std::move(exposures), .reboots = {}};
  for (const Fault& fault : script.faults) {
    if (!fault.hits(side)) continue;
    if (fault.kind == FaultKind::kCameraReboot) schedule.reboots.push_back({fault.at_s, fault.for_s});
    int count = 0;
    for (GigeExposure& exposure : schedule.exposures) {
      if (fault.kind == FaultKind::kIdWrap) {
        if (exposure.mission_s < fault.at_s) continue;
        exposure.frame_id = fault.frame_id;
        break;
      }
      if (!fault.covers(exposure.mission_s)) continue;
      const bool hit = count++ % fault.every == 0;
      switch (fault.kind) {
        case FaultKind::kCameraReboot:
          exposure.away = true;
          break;
        case FaultKind::kSkew:
          if (hit) exposure.late_s = fault.offset_s;
          break;
        case FaultKind::kLostFrames:
          if (hit) exposure.lost = true;
          break;
        case FaultKind::kLostPackets:
          if (hit) {
            exposure.lost_packets = fault.packets;
            exposure.resend = fault.resend;
          }
          break;
        default:
          break;
      }
    }
  }
  return schedule;
}

}  // namespace fathom::sim
