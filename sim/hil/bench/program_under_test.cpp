#include "sim/hil/bench/program_under_test.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <system_error>

#include "realtime/base/install_prefix.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

const std::atomic<bool> kNeverStop{false};

std::optional<pid_t> parentOf(const std::filesystem::path& process) {
  std::ifstream file(process / "status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("PPid:")) return static_cast<pid_t>(std::stol(line.substr(5)));
  return std::nullopt;
}

constexpr const char* kLibrary = "lib/fathom/libfathom_stepped_clock.so";

}  // namespace

ProgramUnderTest::ProgramUnderTest(ChildProcess::Options options, const SimulatedVehicleClock& clock)
    : options_(std::move(options)), clock_(clock), child_(std::make_unique<ChildProcess>(options_)) {}

bool ProgramUnderTest::waitUntilArmed(double seconds, const std::atomic<bool>& stop) {
  return child_->waitForLine("armed", seconds, stop);
}

bool ProgramUnderTest::running() {
  const std::scoped_lock lock(mutex_);
  if (child_->running()) {
    if (!outages_.empty() && outages_.back().until_utc_ns == 0 && !killed_ &&
        child_->waitForLine("armed", 0, kNeverStop))
      outages_.back().until_utc_ns = clock_.utcNs();
    return true;
  }
  if (!killed_) return false;
  killed_ = false;
  ++starts_;
  ChildProcess::Options next = options_;
  next.output.replace_filename(options_.output.stem().string() + "-" + std::to_string(starts_) +
                               options_.output.extension().string());
  child_ = std::make_unique<ChildProcess>(next);
  return true;
}

void ProgramUnderTest::signal(int number) {
  const std::scoped_lock lock(mutex_);
  child_->signal(number);
}

std::optional<int> ProgramUnderTest::wait(double seconds) {
  const std::scoped_lock lock(mutex_);
  return child_->wait(seconds);
}

std::optional<pid_t> ProgramUnderTest::mapper() const {
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    pid_t pid = 0;
    if (std::from_chars(name.data(), name.data() + name.size(), pid).ptr != name.data() + name.size())
      continue;
    if (parentOf(entry.path()) == child_->pid()) return pid;
  }
  return std::nullopt;
}

bool ProgramUnderTest::signalProcess(Process process, int number) {
  const std::scoped_lock lock(mutex_);
  if (!child_->running()) return false;
  if (process == Process::kMapper) {
    const auto pid = mapper();
    return pid && ::kill(*pid, number) == 0;
  }
  if (number == SIGCONT) {
    if (!outages_.empty()) outages_.back().until_utc_ns = clock_.utcNs();
  } else {
    outages_.push_back({clock_.utcNs(), 0});
    killed_ = number == SIGKILL;
  }
  child_->signal(number);
  return true;
}

std::vector<ProgramUnderTest::Outage> ProgramUnderTest::outages() {
  const std::scoped_lock lock(mutex_);
  return outages_;
}

SteppedClock::SteppedClock(const std::filesystem::path& shared) : shared_(std::filesystem::absolute(shared)) {
  const int fd = ::open(shared_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  void* memory = MAP_FAILED;
  if (fd >= 0 && ::ftruncate(fd, sizeof *offset_ns_) == 0)
    memory = ::mmap(nullptr, sizeof *offset_ns_, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (fd >= 0) ::close(fd);
  if (memory == MAP_FAILED) throw std::runtime_error(shared_.string() + " cannot be shared with a program");
  offset_ns_ = static_cast<std::int64_t*>(memory);
}

SteppedClock::~SteppedClock() {
  ::munmap(offset_ns_, sizeof *offset_ns_);
  std::error_code ignored;
  std::filesystem::remove(shared_, ignored);
}

std::vector<std::string> SteppedClock::environment() const {
  const auto library = installPrefix() / kLibrary;
  if (!std::filesystem::exists(library)) return {};
  return {"LD_PRELOAD=" + library.string(), "FATHOM_CLOCK_STEP=" + shared_.string()};
}

void SteppedClock::step(double seconds) {
  std::atomic_ref<std::int64_t>(*offset_ns_).fetch_add(rt::nanoseconds(seconds));
}

}  // namespace fathom::sim
