#include "sim/hil/bench/program_under_test.hpp"

#include <signal.h>

#include <charconv>
#include <filesystem>
#include <fstream>
#include <string>

namespace fathom::sim {
namespace {

const std::atomic<bool> kNeverStop{false};

std::optional<pid_t> parentOf(const std::filesystem::path& process) {
  std::ifstream file(process / "status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("PPid:")) return static_cast<pid_t>(std::stol(line.substr(5)));
  return std::nullopt;
}

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

}  // namespace fathom::sim
