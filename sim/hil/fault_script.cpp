#include "sim/hil/fault_script.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "realtime/base/config_table.hpp"

namespace fathom::sim {
namespace {

constexpr double kLongestMission = 1e6;  // [s]
// Devices that faults act on: two faults at one time on one device would mix their counts.
enum Device : unsigned {
  kLeft = 1,
  kRight = 2,
  kCan = 4,
  kDvl = 8,
  kModem = 16,
  kDisk = 32,
  kCpu = 64,
  kClock = 128,
  kProgram = 256,
  kCameras = kLeft | kRight  // those that the fault names
};

struct Kind {
  std::string_view name;
  unsigned devices;
};
// By FaultKind.
constexpr std::array<Kind, kFaultKinds> kKinds = {{{"lost_packets", kCameras},
                                                   {"lost_frames", kCameras},
                                                   {"skew", kCameras},
                                                   {"id_wrap", kCameras},
                                                   {"camera_reboot", kCameras},
                                                   {"can_bus_off", kCan},
                                                   {"dvl_garbage", kDvl},
                                                   {"dvl_silence", kDvl},
                                                   {"modem_silence", kModem},
                                                   {"disk_full", kDisk},
                                                   {"cpu_hog", kCpu},
                                                   {"clock_step", kClock},
                                                   {"mapper_killed", kProgram},
                                                   {"mapper_stopped", kProgram},
                                                   {"vehicle_killed", kProgram},
                                                   {"vehicle_stopped", kProgram}}};

unsigned devicesOf(const Fault& f) {
  const unsigned devices = kKinds[static_cast<std::size_t>(f.kind)].devices;
  return devices == kCameras ? (f.left ? kLeft : 0U) | (f.right ? kRight : 0U) : devices;
}

// Reads the keys of each kind beside at_s and for_s; finish() refuses keys of other kinds.
void readOwnKeys(const ConfigTable& t, Fault& f) {
  const auto camera = [&] {
    const std::string which = t.choice("camera", "left", {"left", "right", "both"});
    f.left = which != "right";
    f.right = which != "left";
  };
  const auto every = [&] { f.every = static_cast<int>(t.integer("every", f.every, 1, 1000000)); };
  switch (f.kind) {
    case FaultKind::kLostPackets:
      camera();
      every();
      f.packets = static_cast<int>(t.integer("packets", f.packets, 1, 10000));
      f.resend = t.boolean("resend", f.resend);
      break;
    case FaultKind::kLostFrames:
      camera();
      every();
      break;
    case FaultKind::kSkew:
      camera();
      f.offset_s = t.number("offset_s", f.offset_s, 1e-6, 10);
      break;
    case FaultKind::kIdWrap:
      camera();
      f.frame_id = static_cast<int>(t.integer("frame_id", f.frame_id, 60000, 65535));
      break;
    case FaultKind::kCameraReboot:
      camera();
      break;
    case FaultKind::kDvlGarbage:
      every();
      f.noise_bytes = static_cast<int>(t.integer("noise_bytes", f.noise_bytes, 0, 4096));
      break;
    case FaultKind::kDiskFull:
      f.leave_mib = t.number("leave_mib", f.leave_mib, 0, 1e6);
      break;
    case FaultKind::kCpuHog:
      f.threads = static_cast<int>(t.integer("threads", f.threads, 1, 256));
      break;
    case FaultKind::kClockStep:
      f.step_s = t.number("step_s", f.step_s, -1e6, 1e6);
      if (std::abs(f.step_s) < 1e-3) t.fail("step_s", "is no step; give 1 ms or more, forward or back");
      break;
    default:
      break;
  }
}

// Faults without a duration.
bool isInstant(FaultKind kind) {
  return kind == FaultKind::kIdWrap || kind == FaultKind::kMapperKilled || kind == FaultKind::kVehicleKilled;
}

Fault readFault(const ConfigTable& t) {
  Fault f;
  const std::string kind = t.requiredText("kind");
  const auto found = std::ranges::find(kKinds, kind, &Kind::name);
  if (found == kKinds.end()) {
    std::string list;
    for (const Kind& known : kKinds) list += (list.empty() ? "" : ", ") + std::string(known.name);
    t.fail("kind", "'" + kind + "' is none of: " + list);
  }
  f.kind = static_cast<FaultKind>(found - kKinds.begin());
  f.at_s = t.requiredNumber("at_s", 0, kLongestMission);
  if (isInstant(f.kind)) {
    f.for_s = 0;
  } else if (f.kind == FaultKind::kClockStep) {
    f.for_s = t.number("for_s", 0, 0, kLongestMission);
  } else {
    f.for_s = t.requiredNumber("for_s", 1e-3, kLongestMission);
  }
  readOwnKeys(t, f);
  return f;
}

// Whether the half-open intervals overlap; a fault without duration overlaps one that contains its time.
bool overlap(const Fault& a, const Fault& b) {
  if (a.at_s == b.at_s) return true;
  const Fault& first = a.at_s < b.at_s ? a : b;
  return std::max(a.at_s, b.at_s) < first.at_s + first.for_s;
}

FaultScript readScript(const ConfigTable& file) {
  FaultScript script;
  for (const ConfigTable& t : file.tables("fault")) {
    const Fault fault = readFault(t);
    for (const Fault& other : script.faults) {
      if ((devicesOf(other) & devicesOf(fault)) != 0 && overlap(other, fault))
        t.fail("at_s",
               "overlaps the " + std::string(nameOf(other.kind)) +
                   " on the same device; separate their times, so that their counts are distinguishable");
    }
    script.faults.push_back(fault);
  }
  file.finish();
  std::stable_sort(script.faults.begin(), script.faults.end(),
                   [](const Fault& a, const Fault& b) { return a.at_s < b.at_s; });
  return script;
}

// Number of the times within the fault that it hits.
std::uint64_t countHit(const Fault& f, const std::vector<double>& times) {
  const auto in_time = std::count_if(times.begin(), times.end(), [&](double t) { return f.covers(t); });
  return static_cast<std::uint64_t>((in_time + f.every - 1) / f.every);
}

}  // namespace

std::string_view nameOf(FaultKind kind) {
  return kKinds[static_cast<std::size_t>(kind)].name;
}

const Fault* FaultScript::camera(FaultKind kind, CameraSide side, double mission_s) const {
  for (const Fault& f : faults)
    if (f.kind == kind && f.hits(side) && f.covers(mission_s)) return &f;
  return nullptr;
}

const Fault* FaultScript::at(FaultKind kind, double mission_s) const {
  for (const Fault& f : faults)
    if (f.kind == kind && f.covers(mission_s)) return &f;
  return nullptr;
}

std::array<std::uint64_t, kFaultKinds> FaultScript::expectedCounts(const PlayedTimes& times) const {
  double end_s = 0;
  for (const auto* list : {&times.left_s, &times.right_s, &times.dvl_s})
    if (!list->empty()) end_s = std::max(end_s, list->back());
  std::array<std::uint64_t, kFaultKinds> counts{};
  for (const Fault& f : faults) {
    std::uint64_t& count = counts[static_cast<std::size_t>(f.kind)];
    switch (f.kind) {
      case FaultKind::kLostPackets:
      case FaultKind::kLostFrames:
      case FaultKind::kSkew:
        if (f.left) count += countHit(f, times.left_s);
        if (f.right) count += countHit(f, times.right_s);
        break;
      case FaultKind::kDvlGarbage:
      case FaultKind::kDvlSilence:
        count += countHit(f, times.dvl_s);
        break;
      case FaultKind::kIdWrap:
      case FaultKind::kCameraReboot:
        if (f.at_s <= end_s) count += (f.left ? 1U : 0U) + (f.right ? 1U : 0U);
        break;
      case FaultKind::kClockStep:
        if (f.at_s <= end_s) ++count;
        if (f.for_s > 0 && f.at_s + f.for_s <= end_s) ++count;
        break;
      default:
        if (f.at_s <= end_s) ++count;
        break;
    }
  }
  return counts;
}

FaultScript readFaultScript(const std::filesystem::path& path) {
  return readScript(ConfigTable::load(path));
}

FaultScript parseFaultScript(std::string_view text, const std::string& name) {
  return readScript(ConfigTable::parse(text, name));
}

}  // namespace fathom::sim
