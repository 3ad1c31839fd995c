#include "realtime/onboard/live/resume.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "firmware_if/mission/log/onboard_input.hpp"
#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/vehicle_clock.hpp"

namespace fathom::onboard {
namespace {

// Of a saved state: what navigation, its first section, takes at most.
constexpr std::size_t kNavigationBytes = std::size_t{1} << 20;

std::string textOf(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Navigation as a saved state has it, and the reader behind that state's mark; false where none can be used.
bool beginWithSaved(const CheckpointFiles& files, const CheckpointNames& names, HardTier& hard,
                    io::LogInputReader& log, VehicleResume& resume) {
  for (const CheckpointHead& head : files.usable(names.configuration, names.mission, resume.said)) {
    const auto start = files.readStart(head.number, kNavigationBytes, resume.said);
    if (!start || !log.seekBehindMark(head.number, head.inputs, head.utc_ns)) continue;
    rt::StateReader reader(start->state);
    if (!reader(hard.nav())) {
      resume.said.push_back(files.file(head.number).string() + ": passed over by navigation (" +
                            reader.failure() + ")");
      continue;
    }
    resume.last_ns = head.utc_ns;
    return true;
  }
  return false;
}

// Follows the log to its end.
void follow(const std::filesystem::path& folder, io::LogInputReader& log, HardTier& hard,
            VehicleResume& resume) {
  io::LogInputReader::Entry entry;
  for (;;) {
    switch (log.next(entry)) {
      case io::LogInputReader::Step::kEnd:
        return;
      case io::LogInputReader::Step::kUnreadable:
        resume.said.push_back("sensors.lcmlog: " + log.failure() + "; navigation continues from there");
        return;
      case io::LogInputReader::Step::kInput:
        break;
      default:
        continue;
    }
    hard.follow(entry.input);
    resume.last_ns = std::max(resume.last_ns, entry.input.arrival_utc_ns);
    const auto* mark = std::get_if<io::Mark>(&entry.input.what);
    if (mark == nullptr) continue;
    if (mark->kind == io::Mark::Kind::kEnd)
      throw InputError(folder, "sensors.lcmlog", "this dive has ended; give each dive a folder of its own");
    if (mark->kind == io::Mark::Kind::kCheckpoint)
      resume.newest_checkpoint = std::max(resume.newest_checkpoint, mark->number);
  }
}

}  // namespace

VehicleResume resumeNavigation(const std::filesystem::path& folder, const CheckpointNames& names,
                               HardTier& hard) {
  VehicleResume resume;
  const NavFeed before = hard.nav();
  io::LogInputReader log(folder);
  try {
    const CheckpointFiles files(stateFolder(folder));
    resume.newest_checkpoint = files.newestNumber();
    if (!beginWithSaved(files, names, hard, log, resume)) {
      hard.nav() = before;
      log = io::LogInputReader(folder);
    }
  } catch (const InputError& e) {
    resume.said.emplace_back(e.what());
    hard.nav() = before;
  }
  follow(folder, log, hard, resume);
  resume.position = log.position();
  return resume;
}

std::int64_t newestArrival(const std::filesystem::path& folder) {
  constexpr std::uint64_t kNewest = std::uint64_t{1} << 18;  // a minute or more
  const std::filesystem::path log = io::MissionPaths(folder).log();
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(log, error);
  if (error || size == 0) return 0;
  std::int64_t newest_us = 0;
  try {
    io::LogEventReader events(log, size > kNewest ? size - kNewest : 0);
    io::LogEvent event;
    while (events.next(event))
      if (io::carriesInput(event.channel)) newest_us = std::max(newest_us, event.timestamp_us);
  } catch (const InputError&) {
    return 0;  // its full reader reports why
  }
  return newest_us * 1000;
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
    // A full disk holds up no start: the next one continues from the log's end.
  }
  return start.offset_ns;
}

}  // namespace fathom::onboard
