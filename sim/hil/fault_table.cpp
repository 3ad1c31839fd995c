#include "sim/hil/fault_table.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = line.find(',');
    fields.push_back(line.substr(0, comma));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

template <class Number>
bool parse(std::string_view text, Number& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

std::uint64_t countFate(const std::vector<CameraLogRow>& log, const char* fate) {
  return static_cast<std::uint64_t>(
      std::count_if(log.begin(), log.end(), [&](const CameraLogRow& row) { return row.fate == fate; }));
}

}  // namespace

std::vector<CameraLogRow> readCameraLog(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string line;
  if (!file || !std::getline(file, line))
    throw InputError(path.string(), "", "is no log of a simulated camera");
  const std::string header = line;
  const std::vector<std::string_view> names = split(header);
  const auto column = [&](std::string_view name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      throw InputError(path.string(), "line 1",
                       "has no column " + std::string(name) + "; give a camera's --log");
    return static_cast<std::size_t>(found - names.begin());
  };
  const std::size_t mission = column("mission_s"), image = column("file"), id = column("frame_id"),
                    exposed = column("exposed_utc_ns"), fate = column("fate"), lost = column("packets_lost");
  std::vector<CameraLogRow> rows;
  while (std::getline(file, line)) {
    const std::vector<std::string_view> fields = split(line);
    if (fields.size() != names.size()) continue;
    CameraLogRow row;
    row.file = fields[image];
    row.fate = fields[fate];
    if (parse(fields[mission], row.mission_s) && parse(fields[id], row.frame_id) &&
        parse(fields[exposed], row.exposed_utc_ns) && parse(fields[lost], row.packets_lost))
      rows.push_back(std::move(row));
  }
  return rows;
}

std::uint64_t FaultTable::counter(const nlohmann::json& json, std::initializer_list<const char*> path) {
  const nlohmann::json* at = &json;
  for (const char* name : path) {
    if (!at->is_object() || !at->contains(name)) return 0;
    at = &(*at)[name];
  }
  return at->is_number() ? static_cast<std::uint64_t>(at->get<double>()) : 0;
}

bool FaultTable::arrivedComplete(CameraSide side, const CameraLogRow& row) const {
  if (row.fate != "sent") return false;
  if (row.packets_lost == 0) return true;
  const Fault* fault = script_.camera(FaultKind::kLostPackets, side, row.mission_s);
  return fault != nullptr && fault->resend;
}

bool FaultTable::Row::good() const {
  if (counter.empty()) return true;
  return exact ? counted == injected : (counted > 0) == (injected > 0);
}

void FaultTable::add(FaultKind kind, std::uint64_t injected, std::uint64_t counted,
                     const std::string& counter, bool exact) {
  const std::uint64_t asked = asked_[static_cast<std::size_t>(kind)];
  if (asked > 0 || injected > 0) rows_.push_back({kind, asked, injected, counted, counter, exact});
}

FaultTable::FaultTable(const FaultScript& script, const nlohmann::json& run, const nlohmann::json& live,
                       const nlohmann::json& report, const std::vector<CameraLogRow>& left,
                       const std::vector<CameraLogRow>& right)
    : script_(script) {
  for (std::size_t i = 0; i < kFaultKinds; ++i)
    asked_.push_back(counter(run, {"expected", std::string(nameOf(static_cast<FaultKind>(i))).c_str()}));
  const auto asked = [&](FaultKind kind) { return asked_[static_cast<std::size_t>(kind)]; };
  const auto both = [&](const char* name) {
    return counter(live, {"devices", "camera_left", name}) + counter(live, {"devices", "camera_right", name});
  };
  const auto done = [&](FaultKind kind) {
    return counter(run, {"injected", std::string(nameOf(kind)).c_str()});
  };

  std::uint64_t incomplete = 0, resent = 0, skewed = 0;
  for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight})
    for (const CameraLogRow& row : side == CameraSide::kLeft ? left : right) {
      if (row.fate != "sent") continue;
      if (!arrivedComplete(side, row))
        ++incomplete;
      else if (row.packets_lost > 0)
        ++resent;
      if (script_.camera(FaultKind::kSkew, side, row.mission_s) != nullptr) ++skewed;
    }
  const std::uint64_t arrived_incomplete = both("incomplete") + both("timed_out");
  if (resent == 0 || incomplete + arrived_incomplete > 0)
    add(FaultKind::kLostPackets, incomplete, arrived_incomplete, "cameras: incomplete + timed_out", true);
  if (resent > 0)
    add(FaultKind::kLostPackets, resent, both("resent_packets"), "cameras: resent_packets", false);
  const std::uint64_t lost = countFate(left, "lost") + countFate(right, "lost");
  add(FaultKind::kLostFrames, lost, both("missed"), "cameras: missed", true);
  add(FaultKind::kSkew, skewed,
      counter(report, {"health", "nav_left_unpaired"}) + counter(report, {"health", "nav_right_unpaired"}),
      "navigation: unpaired, either side", false);
  add(FaultKind::kIdWrap, asked(FaultKind::kIdWrap), 0, "", true);
  add(FaultKind::kCameraReboot, asked(FaultKind::kCameraReboot), both("clock_resets"),
      "cameras: clock_resets", true);
  const std::uint64_t bus_off = counter(run, {"lcm", "withheld"}) > 0 ? asked(FaultKind::kCanBusOff) : 0;
  add(FaultKind::kCanBusOff, bus_off, 0, "", true);
  add(FaultKind::kDvlGarbage, done(FaultKind::kDvlGarbage), counter(live, {"devices", "dvl", "bad_checksum"}),
      "dvl: bad_checksum", true);
  const auto silences = std::ranges::count(script_.faults, FaultKind::kDvlSilence, &Fault::kind);
  add(FaultKind::kDvlSilence, done(FaultKind::kDvlSilence) == 0 ? 0 : static_cast<std::uint64_t>(silences),
      counter(live, {"devices", "dvl", "silences"}), "dvl: silences", true);
  add(FaultKind::kModemSilence, asked(FaultKind::kModemSilence), 0, "", true);
  add(FaultKind::kDiskFull, done(FaultKind::kDiskFull), counter(live, {"recorder", "images_dropped_disk"}),
      "recorder: images_dropped_disk", false);
  add(FaultKind::kCpuHog, done(FaultKind::kCpuHog), 0, "", true);
  add(FaultKind::kClockStep, done(FaultKind::kClockStep), counter(live, {"clock_steps"}), "clock_steps",
      true);
  const std::uint64_t starts = counter(live, {"mapper_starts"});
  // A restarted program resets its counters.
  add(FaultKind::kMapperKilled, done(FaultKind::kMapperKilled), starts > 0 ? starts - 1 : 0,
      done(FaultKind::kVehicleKilled) > 0 ? "" : "mapper_starts", false);
  add(FaultKind::kMapperStopped, done(FaultKind::kMapperStopped), 0, "", true);
  add(FaultKind::kVehicleKilled, done(FaultKind::kVehicleKilled), live.value("resumed", false) ? 1 : 0,
      "resumed", false);
  add(FaultKind::kVehicleStopped, done(FaultKind::kVehicleStopped), 0, "", true);
}

bool FaultTable::print(std::FILE* out) const {
  std::fprintf(out, "%-14s %7s %9s %8s  %s\n", "fault", "asked", "injected", "counted", "by");
  bool good = true;
  for (const Row& r : rows_) {
    const std::string counted = r.counter.empty() ? "-" : std::to_string(r.counted);
    std::fprintf(out, "%-14s %7llu %9llu %8s  %s%s\n", std::string(nameOf(r.kind)).c_str(),
                 static_cast<unsigned long long>(r.asked), static_cast<unsigned long long>(r.injected),
                 counted.c_str(), r.counter.empty() ? "its effect only" : r.counter.c_str(),
                 r.good() ? "" : "  BAD");
    good = good && r.good();
  }
  return good;
}

nlohmann::ordered_json FaultTable::json() const {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const Row& r : rows_)
    all.push_back({{"kind", std::string(nameOf(r.kind))},
                   {"asked", r.asked},
                   {"injected", r.injected},
                   {"counted", r.counted},
                   {"counter", r.counter},
                   {"good", r.good()}});
  return all;
}

}  // namespace fathom::sim
