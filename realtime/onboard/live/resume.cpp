#include "realtime/onboard/live/resume.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "firmware_if/log/input_tail.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/vehicle_clock.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/colour_matrix.hpp"

namespace fathom::onboard {
namespace {

std::string textOf(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool hasLog(const std::filesystem::path& folder) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(io::MissionPaths(folder).log(), error);
  return !error && bytes > 0;
}

}  // namespace

CheckpointNames checkpointNames(const std::filesystem::path& folder, const OnboardConfig& config,
                                const io::MissionConfig& mission) {
  CheckpointNames names;
  const std::filesystem::path calib = io::MissionPaths(folder).calib();
  names.configuration = checkpointHash(config.text);
  for (const std::filesystem::path& file : {calib, coloursBeside(calib), folder / "mission.toml"})
    names.configuration = checkpointHash(textOf(file), names.configuration);
  names.mission =
      checkpointHash(mission.vehicle_name + " " + std::to_string(mission.vehicle_id) + " " +
                     std::to_string(mission.dive_id) + " " + std::to_string(mission.start_utc_ns));
  return names;
}

Resume readResume(const std::filesystem::path& folder, CheckpointFiles& files, const CheckpointNames& names) {
  Resume resume;
  if (!hasLog(folder)) return resume;
  io::InputTail tail;
  for (;;) {
    resume.checkpoint = files.readNewest(names.configuration, names.mission, resume.said);
    tail = io::readInputTail(folder, resume.number(),
                             resume.checkpoint ? resume.checkpoint->head.utc_ns : INT64_MIN);
    if (!resume.checkpoint || tail.mark_found) break;
    // It got to the disk before the log did. Its number will be given again, so it must not be found then.
    resume.said.push_back("checkpoint " + std::to_string(resume.number()) +
                          ": passed over, the log does not reach to its mark");
    files.remove(resume.number());
  }
  resume.tail = std::move(tail.inputs);
  resume.newest_number = resume.number();
  resume.last_ns = resume.checkpoint ? resume.checkpoint->head.utc_ns : 0;
  for (const io::OnboardInput& input : resume.tail) {
    if (const auto* decision = std::get_if<io::Decision>(&input.what)) {
      resume.decisions[decision->pair_index] = *decision;
      continue;
    }
    resume.last_ns = std::max(resume.last_ns, input.arrival_utc_ns);
    const auto* mark = std::get_if<io::Mark>(&input.what);
    if (mark == nullptr) continue;
    if (mark->kind == io::Mark::Kind::kEnd)
      throw InputError(folder, "sensors.lcmlog", "this dive has ended; give each dive a folder of its own");
    if (mark->kind == io::Mark::Kind::kCheckpoint)
      resume.newest_number = std::max(resume.newest_number, mark->number);
  }
  return resume;
}

std::int64_t vehicleClockOffset(const std::filesystem::path& state_folder, std::int64_t last_ns,
                                std::int64_t* clock_behind_ns) {
  std::error_code ignored;
  std::filesystem::create_directories(state_folder, ignored);
  const std::filesystem::path path = state_folder / "clock.txt";
  std::string boot = textOf("/proc/sys/kernel/random/boot_id");
  while (!boot.empty() && boot.back() == '\n') boot.pop_back();
  std::ifstream in(path);
  std::string then;
  std::int64_t kept_ns = 0;
  const bool kept = in >> then >> kept_ns && then == boot && !boot.empty();
  const rt::ClockStart start =
      rt::beginVehicleTime(rt::VehicleClock::systemOffsetNs(), kept ? std::optional(kept_ns) : std::nullopt,
                           rt::RealClock().monotonicNs(), last_ns);
  if (clock_behind_ns != nullptr) *clock_behind_ns = start.behind_ns;
  if (kept && start.offset_ns == kept_ns) return kept_ns;
  try {
    writeFile(path, boot + ' ' + std::to_string(start.offset_ns) + "\n");
  } catch (const std::runtime_error&) {
    // A full disk holds up no start: the next one goes on from the log's end.
  }
  return start.offset_ns;
}

}  // namespace fathom::onboard
