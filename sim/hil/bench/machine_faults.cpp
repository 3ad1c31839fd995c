#include "sim/hil/bench/machine_faults.hpp"

#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

bool runShell(const std::string& command) {
  return std::system((command + " >/dev/null 2>&1").c_str()) == 0;
}

std::string quoted(const std::filesystem::path& path) {
  std::string out = "'";
  for (const char c : path.string()) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::uint64_t freeBytes(const std::filesystem::path& folder) {
  struct statvfs figures {};
  if (::statvfs(folder.c_str(), &figures) != 0) return 0;
  return static_cast<std::uint64_t>(figures.f_bavail) * figures.f_frsize;
}

// Faults injected by this class.
bool isMachineFault(FaultKind kind) {
  return kind >= FaultKind::kDiskFull;
}

bool stops(FaultKind kind) {
  return kind == FaultKind::kMapperStopped || kind == FaultKind::kVehicleStopped;
}

ProgramUnderTest::Process processOf(FaultKind kind) {
  const bool mapper = kind == FaultKind::kMapperKilled || kind == FaultKind::kMapperStopped;
  return mapper ? ProgramUnderTest::Process::kMapper : ProgramUnderTest::Process::kVehicle;
}

}  // namespace

std::string RecordingDisk::open(const std::filesystem::path& folder, std::uint64_t written,
                                std::uint64_t taken_unwritten) {
  folder_ = std::filesystem::absolute(folder);
  image_ = folder_.string() + ".disk";
  if (freeBytes(folder_.parent_path()) < 2 * written)
    return "its folder has less than twice the " + std::to_string(written >> 20) +
           " MiB that a disk of its own takes";
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0)
    return std::string("no mounts of its own (") + std::strerror(errno) + "): run as root";
  std::ofstream(image_).close();
  std::error_code error;
  std::filesystem::resize_file(image_, written + taken_unwritten, error);
  // Without blocks reserved for root.
  const bool mounted = !error && runShell("mkfs.ext4 -q -F -m 0 " + quoted(image_)) &&
                       runShell("mount -o loop " + quoted(image_) + " " + quoted(folder_));
  if (!mounted) {
    std::filesystem::remove(image_, error);
    return "no file system in a file (needs mkfs.ext4 and loop devices)";
  }
  std::filesystem::remove(folder_ / "lost+found", error);
  open_ = true;
  return "";
}

bool RecordingDisk::fill(double leave_mib) {
  const int fd = ::open(filler().c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (fd < 0) return false;
  const auto leave = static_cast<std::uint64_t>(leave_mib * kMebibyte);
  // Ever smaller pieces, since metadata takes a part of the free space.
  off_t size = 0;
  for (std::uint64_t piece = 256ULL << 20; piece >= 4096; piece /= 2) {
    while (true) {
      const std::uint64_t free = freeBytes(folder_);
      if (leave > 0 && free < leave + piece) break;
      if (::posix_fallocate(fd, size, static_cast<off_t>(piece)) != 0) break;
      size += static_cast<off_t>(piece);
    }
  }
  ::close(fd);
  constexpr std::uint64_t kNearlyNothing = 1 << 20;  // left on a full file system [bytes]
  return freeBytes(folder_) <= leave + kNearlyNothing;
}

void RecordingDisk::makeRoom() {
  std::error_code ignored;
  std::filesystem::remove(filler(), ignored);
}

void RecordingDisk::close() {
  if (!open_) return;
  makeRoom();
  const std::filesystem::path copy = folder_.string() + ".kept";
  if (!runShell("rm -rf " + quoted(copy)) || !runShell("cp -a " + quoted(folder_) + " " + quoted(copy)) ||
      !runShell("umount " + quoted(folder_)))
    throw std::runtime_error("the recording cannot be copied from its disk; it is in " + image_.string());
  open_ = false;
  std::filesystem::remove(folder_);
  std::filesystem::rename(copy, folder_);
  std::filesystem::remove(image_);
}

RecordingDisk::~RecordingDisk() {
  if (!open_) return;
  try {
    close();
  } catch (const std::exception&) {
    // The image is kept; a destructor cannot report the failure.
    open_ = false;
  }
}

MachineFaults::MachineFaults(const MissionSchedule& schedule, const FaultScript& script,
                             SimulatedVehicleClock& clock, RecordingDisk* disk, SteppedClock* stepped,
                             ProgramUnderTest* program)
    : schedule_(schedule),
      script_(script),
      clock_(clock),
      disk_(disk),
      stepped_(stepped),
      program_(program) {}

void MachineFaults::begin(const Fault& fault) {
  std::uint64_t& count = done_[static_cast<std::size_t>(fault.kind)];
  switch (fault.kind) {
    case FaultKind::kDiskFull:
      if (disk_ == nullptr) {
        notes_.emplace_back("disk_full was not done: the recording has no disk of its own");
      } else if (disk_->fill(fault.leave_mib)) {
        ++count;
      } else {
        notes_.emplace_back("disk_full was not done: the disk could not be filled");
      }
      break;
    case FaultKind::kCpuHog:
      hog_.start(fault.threads);
      ++count;
      break;
    case FaultKind::kClockStep:
      if (stepped_ == nullptr) {
        notes_.emplace_back("clock_step was not done: the bench has not started the program");
      } else {
        stepped_->step(fault.step_s);
        ++count;
      }
      break;
    case FaultKind::kMapperKilled:
    case FaultKind::kVehicleKilled:
    case FaultKind::kMapperStopped:
    case FaultKind::kVehicleStopped:
      if (program_ != nullptr &&
          program_->signalProcess(processOf(fault.kind), stops(fault.kind) ? SIGSTOP : SIGKILL))
        ++count;
      else
        notes_.push_back(std::string(nameOf(fault.kind)) + " was not done: the bench has no such process");
      break;
    default:
      break;
  }
}

void MachineFaults::end(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::kDiskFull:
      if (disk_ != nullptr) disk_->makeRoom();
      break;
    case FaultKind::kCpuHog:
      hog_.stop();
      break;
    case FaultKind::kClockStep:
      if (stepped_ != nullptr && fault.for_s > 0) {
        stepped_->step(-fault.step_s);
        ++done_[static_cast<std::size_t>(fault.kind)];
      }
      break;
    // The process may have been killed before.
    case FaultKind::kMapperStopped:
    case FaultKind::kVehicleStopped:
      if (program_ != nullptr) (void)program_->signalProcess(processOf(fault.kind), SIGCONT);
      break;
    default:
      break;
  }
}

void MachineFaults::run(const std::atomic<bool>& stop) {
  struct Event {
    double mission_s = 0;
    const Fault* fault = nullptr;
    bool begins = true;
  };
  std::vector<Event> events;
  for (const Fault& f : script_.faults) {
    if (!isMachineFault(f.kind)) continue;
    if (schedule_.vehicleTime(f.at_s) > schedule_.end_utc_ns) continue;
    events.push_back({f.at_s, &f, true});
    events.push_back({f.at_s + f.for_s, &f, false});
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.mission_s < b.mission_s; });
  std::vector<const Fault*> open;
  for (const Event& m : events) {
    if (!clock_.sleepUntil(schedule_.vehicleTime(m.mission_s), stop)) break;
    if (m.begins) {
      open.push_back(m.fault);
      begin(*m.fault);
    } else {
      std::erase(open, m.fault);
      end(*m.fault);
    }
  }
  for (const Fault* fault : open) end(*fault);
}

}  // namespace fathom::sim
