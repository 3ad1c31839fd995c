#include "firmware_if/predive/predive_command.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "firmware_if/devices/camera/camera_discovery.hpp"
#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/devices/can/bus/can_source.hpp"
#include "firmware_if/devices/device_address.hpp"
#include "firmware_if/devices/dvl/dvl_source.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "firmware_if/predive/predive_checks.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::io {
namespace {

const char* word(PrediveVerdict verdict) {
  switch (verdict) {
    case PrediveVerdict::kGood:
      return "good";
    case PrediveVerdict::kBad:
      return "bad";
    case PrediveVerdict::kAdvice:
      return "advice";
    case PrediveVerdict::kUnused:
      break;
  }
  return "unused";
}

// Of a row in a terminal: the colour's escape, and the word before it.
std::pair<const char*, const char*> lookOf(PrediveVerdict verdict) {
  switch (verdict) {
    case PrediveVerdict::kGood:
      return {"\033[32m", "green"};
    case PrediveVerdict::kBad:
      return {"\033[1;31m", "RED  "};
    case PrediveVerdict::kAdvice:
      return {"\033[33m", "note "};
    case PrediveVerdict::kUnused:
      break;
  }
  return {"\033[90m", "-    "};
}

// The tables of onboard.toml that are about devices and the machine; the map's are fathom-onboard's own.
struct Configuration {
  PrediveConfig limits;
  StereoCameraConfig cameras;
  CanConfig can;
  DvlConfig dvl;
  LcmConfig lcm;
  std::string modem;
  RecorderConfig recorder;
  rt::RealtimeConfig realtime;
  rt::MemoryConfig memory;
  PrediveLink link;
};

Configuration readConfiguration(const std::filesystem::path& path, const MissionConfig& mission,
                                const MakePrediveLink& make_link) {
  const ConfigTable root = ConfigTable::load(path);
  Configuration config;
  const auto read = [&](const char* name, auto& values, const auto& visit) {
    ConfigReader keys(root.table(name));
    visit(keys, values);
    keys.finish();
  };
  read("predive", config.limits, visitPredive);
  read("cameras", config.cameras,
       [&](KeyVisitor& keys, StereoCameraConfig& c) { visitCameras(keys, c, mission); });
  read("can", config.can, visitCan);
  read("dvl", config.dvl, visitDvl);
  read("lcm", config.lcm, visitLcm);
  read("recorder", config.recorder, visitRecorder);
  read("realtime", config.realtime, rt::visitRealtime);
  read("memory", config.memory, rt::visitMemory);
  ConfigReader modem(root.table("modem"));
  visitModem(modem, config.modem);
  if (make_link) config.link = make_link(mission, root.table("link"));
  config.can.samples.latitude = mission.origin.latitude;
  return config;
}

// A file that must be readable: its row, and what it holds.
template <class Read>
auto readFile(const char* name, PrediveReport& report, const Read& read) -> std::optional<decltype(read())> {
  try {
    auto value = read();
    report.good(name, "readable");
    return value;
  } catch (const std::exception& error) {
    report.bad(name, error.what(), "correct it, and look again");
    return std::nullopt;
  }
}

// A device that cannot be opened at all is a red row; the others are still checked.
template <class Open>
void openDevice(const char* name, PrediveReport& report, const Open& open) {
  try {
    open();
  } catch (const std::exception& error) {
    report.bad(name, error.what(), "correct its table in onboard.toml");
  }
}

// A camera that could not be opened may still answer the search, with its serial number.
PrediveIdentity identityOf(const GigeCamera& camera, const CameraConfig& wanted) {
  PrediveIdentity identity{camera.serial(), camera.address(), camera.lastFailure(), !camera.serial().empty()};
  if (identity.answers) return identity;
  for (const FoundCamera& found : findCameras(wanted.interface)) {
    if (!isCamera(found, wanted.id)) continue;
    identity.serial = found.serial;
    identity.address = found.address;
    identity.answers = true;
  }
  return identity;
}

PrediveDevices openDevices(const Configuration& config, const MissionConfig& mission,
                           const rt::VehicleClock& clock, PrediveReport& report) {
  PrediveDevices devices;
  const VehicleTime now = [&clock] { return clock.utcNs(); };
  for (std::size_t side = 0; side < devices.cameras.size(); ++side) {
    if (config.cameras.side[side].id.empty()) continue;
    openDevice("cameras", report, [&] {
      const CameraConfig& wanted = config.cameras.side[side];
      auto camera = std::make_unique<GigeCamera>(wanted, now);
      const GigeCamera* opened = camera.get();
      devices.cameras[side] = {std::move(camera), [opened, wanted] { return identityOf(*opened, wanted); }};
    });
  }
  if (!config.dvl.device.empty()) {
    devices.expected[SensorSample(DvlSample{}).index()] = true;
    openDevice("DVL port", report,
               [&] { devices.sources.push_back(std::make_unique<DvlSource>(config.dvl, now)); });
  }
  if (!config.can.interface.empty()) {
    devices.expected[SensorSample(AttitudeSample{}).index()] = true;
    devices.expected[SensorSample(DepthSample{}).index()] = true;
    openDevice("CAN port", report,
               [&] { devices.sources.push_back(std::make_unique<CanSource>(config.can, clock)); });
  }
  if (!config.lcm.url.empty()) {
    for (std::size_t kind = 0; kind < devices.expected.size(); ++kind)
      devices.expected[kind] = devices.expected[kind] || config.lcm.accept[kind];
    openDevice("LCM", report, [&] {
      auto bus = std::make_shared<LcmBus>(config.lcm.url);
      devices.sources.push_back(std::make_unique<LcmSource>(config.lcm, bus, mission.vehicle_name, now));
      if (!bus->isOpen()) throw InputError("LCM " + config.lcm.url, "", bus->reason());
    });
  }
  devices.modem_used = !config.modem.empty();
  devices.link = config.link;
  if (devices.modem_used) {
    try {
      auto modem = openFramePort(config.modem, "modem.device " + config.modem);
      if (modem->isOpen())
        devices.modem = std::move(modem);
      else
        devices.modem_failure = modem->reason();
    } catch (const InputError& error) {
      devices.modem_failure = error.what();
    }
  }
  return devices;
}

void checkMachine(const Configuration& config, PrediveReport& report) {
  rt::MemoryBudget budget(config.memory.budget_bytes);
  budget.addFixed("heap", config.memory.heap_bytes);
  for (const CameraConfig& camera : config.cameras.side)
    if (!camera.id.empty()) budget.addFixed("camera", GigeCamera::memoryBytes(camera));
  checkArming(rt::checkArming(config.realtime, budget), report);
}

}  // namespace

bool PrediveReport::allGood() const {
  return std::none_of(rows.begin(), rows.end(),
                      [](const PrediveRow& row) { return row.verdict == PrediveVerdict::kBad; });
}

std::string reportTable(const PrediveReport& report, bool colours) {
  std::size_t width = 0, bad = 0;
  for (const PrediveRow& row : report.rows) width = std::max(width, row.name.size());
  std::string out;
  for (const PrediveRow& row : report.rows) {
    const auto [colour, label] = lookOf(row.verdict);
    bad += row.verdict == PrediveVerdict::kBad ? 1 : 0;
    out += (colours ? colour : "") + std::string(label) + (colours ? "\033[0m" : "") + "  " + row.name +
           std::string(width - row.name.size(), ' ') + "  " + row.found + "\n";
    if (!row.fix.empty()) out += "       " + std::string(width, ' ') + "  -> " + row.fix + "\n";
  }
  out += bad == 0 ? "All is well: ready to dive.\n"
                  : std::to_string(bad) + (bad == 1 ? " thing is" : " things are") + " wrong: do not dive.\n";
  return out;
}

std::string reportJson(const PrediveReport& report) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (const PrediveRow& row : report.rows) {
    nlohmann::ordered_json line = {{"name", row.name}, {"verdict", word(row.verdict)}, {"found", row.found}};
    if (!row.fix.empty()) line["fix"] = row.fix;
    rows.push_back(std::move(line));
  }
  const nlohmann::ordered_json all = {{"good", report.allGood()}, {"rows", std::move(rows)}};
  return all.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

int runPrediveCommand(const PrediveCommand& command, const MakePrediveLink& make_link, std::FILE* out) {
  const rt::VehicleClock clock(rt::VehicleClock::systemOffsetNs());
  const MissionPaths paths(command.folder);
  PrediveReport report;
  const auto mission = readFile("mission.toml", report, [&] { return readMissionConfig(paths.root); });
  const auto rig = readFile("stereo.calib", report, [&] { return readStereoCalib(paths.calib()); });
  std::optional<Configuration> config;
  if (mission)
    config = readFile("onboard.toml", report,
                      [&] { return readConfiguration(command.config, *mission, make_link); });
  if (mission && rig) {
    checkExtrinsics(*mission, *rig, config ? config->limits : PrediveConfig{}, report);
    if (config) {
      PrediveDevices devices = openDevices(*config, *mission, clock, report);
      const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(command.seconds);
      const PrediveFacts facts = watchDevices(
          devices, [end] { return std::chrono::steady_clock::now() < end; },
          [&clock] { return clock.utcNs(); });
      checkCameras(facts, config->cameras, *mission, *rig, config->limits, report);
      checkSensors(facts, *mission, config->limits, report);
      checkClocks(facts, rt::readSystemClock(), config->limits, report);
      checkDisk(config->recorder, *mission, *rig, freeBytes(command.folder), report);
      checkMachine(*config, report);
    }
  }
  const std::string text = command.json ? reportJson(report) : reportTable(report, command.colours);
  if (std::fwrite(text.data(), 1, text.size(), out) != text.size() || std::fflush(out) != 0)
    throw std::runtime_error(std::string("the table cannot be written: ") + std::strerror(errno));
  return report.allGood() ? kExitSuccess : kExitFailedWork;
}

}  // namespace fathom::io
