#include "sim/hil/hil_folder.hpp"

#include <fstream>
#include <sstream>
#include <string_view>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"

namespace fathom::sim {
namespace {

std::string readText(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string(), "", "cannot be read; give a configuration of fathom-onboard");
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

bool hasTable(const std::string& toml, const std::string& name) {
  std::istringstream lines(toml);
  for (std::string line; std::getline(lines, line);)
    if (line.compare(0, name.size() + 2, "[" + name + "]") == 0) return true;
  return false;
}

}  // namespace

void makeHilFolder(const HilFolder& folder, bool force) {
  std::error_code error;
  if (std::filesystem::exists(folder.root) && !std::filesystem::is_empty(folder.root, error)) {
    if (!std::filesystem::exists(folder.report()))
      throw InputError(folder.root.string(), "", "has other content than a bench run; name another folder");
    if (!force)
      throw InputError(folder.root.string(), "",
                       "holds a bench run; name another folder, or replace it with --force");
    std::filesystem::remove_all(folder.root);
  }
  std::filesystem::create_directories(folder.mission(), error);
  if (error) throw InputError(folder.root.string(), "", "cannot be created (" + error.message() + ")");
  // Marks the folder as a run, also when it is interrupted.
  writeFile(folder.report(), "{}\n");
}

void writeHilMission(const HilFolder& folder, const MissionSchedule& schedule) {
  io::writeMissionConfig(folder.mission(), schedule.mission);
  writeStereoCalib(io::MissionPaths(folder.mission()).calib(), schedule.rig);
  for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
    AtomicFile list(folder.camera(side, "txt"));
    for (const ScheduledExposure& e : schedule.exposures) {
      if (e.side != side) continue;
      list.stream() << decimals(schedule.missionSeconds(e.utc_ns), 9) << ',' << e.file_name << '\n';
    }
    list.commit();
  }
}

void writeHilConfig(const HilFolder& folder, const MissionSchedule& schedule, const HilOptions& options,
                    const HilDevices& devices) {
  const std::string base = options.config ? readText(*options.config) : "";
  for (const char* table : {"cameras", "dvl", "can", "lcm", "modem"})
    if (hasTable(base, table))
      throw InputError(options.config->string(), std::string("[") + table + "]",
                       "is set by the bench; leave this table out");
  AtomicFile file(folder.config());
  std::ostream& out = file.stream();
  const auto text = [](const std::string& t) { return tomlString(t); };
  if (!base.empty()) out << base << "\n\n";
  out << "# The devices of the bench.\n[cameras]\nleft = " << text(devices.left)
      << "\nright = " << text(devices.right) << "\nwidth = " << schedule.rig.left.width
      << "\nheight = " << schedule.rig.left.height << "\n";
  out << "\n[dvl]\ndevice = " << text(devices.dvl)
      << "\nformat = \"pd0\"\nlatency_s = " << tomlNumber(devices.dvl_latency_s) << "\n";
  if (!devices.lcm.empty())
    out << "\n[lcm]\nurl = " << text(devices.lcm)
        << "\naccept = \"attitude depth gps water battery progress\"\n";
  if (!devices.modem.empty()) out << "\n[modem]\ndevice = " << text(devices.modem) << "\n";
  if (!hasTable(base, "recorder")) {
    const double hours = static_cast<double>(schedule.end_utc_ns - schedule.start_utc_ns) * 1e-9 / 3600;
    // Small reserves, since the bench may fill the disk and its runs are short.
    out << "\n[recorder]\nplanned_hours = " << tomlNumber(hours + 0.05)
        << "\nimage_reserve_mib = 64\nlog_reserve_mib = 8\n";
  }
  if (!hasTable(base, "link")) out << "\n[link]\nrate_bps = " << tomlNumber(options.water.rate_bps) << "\n";
  file.commit();
}

}  // namespace fathom::sim
