#include "tests/onboard/faults/vehicle.hpp"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string_view>
#include <system_error>

#include "realtime/base/command_line.hpp"
#include "realtime/kernel/time/clock.hpp"

namespace fathom::test {
namespace {

// As the unit has them.
constexpr std::int64_t kRestart_ns = 100'000'000, kWatchdog_ns = 5'000'000'000;
// That a start may take until it says that it is armed.
constexpr std::int64_t kStart_ns = 20'000'000'000;

constexpr const char *kMainThread = "main", *kNavigation = "navigation";

std::int64_t machineNs() {
  return rt::RealClock().monotonicNs();
}

void require(bool good, const char* what) {
  if (!good) throw std::system_error(errno, std::generic_category(), what);
}

}  // namespace

void WaitedForCpu::look(pid_t process) {
  const std::string folder = "/proc/" + std::to_string(process) + "/task";
  DIR* tasks = ::opendir(folder.c_str());
  if (tasks == nullptr) return;
  while (const dirent* entry = ::readdir(tasks)) {
    if (entry->d_name[0] == '.') continue;
    const std::string task = folder + "/" + entry->d_name;
    const auto id = static_cast<pid_t>(std::stol(entry->d_name));
    Thread& thread = threads_[id];
    if (thread.name.empty()) {
      std::ifstream comm(task + "/comm");
      if (id == process)
        thread.name = kMainThread;
      else
        std::getline(comm, thread.name);
    }
    if (thread.name != kMainThread && thread.name != "vision" && thread.name != kNavigation) continue;
    double ran_ns = 0, waited_ns = 0;
    if (std::ifstream(task + "/schedstat") >> ran_ns >> waited_ns) thread.now = waited_ns * 1e-9;
  }
  ::closedir(tasks);
}

double WaitedForCpu::all() const {
  double all = 0;
  for (const auto& [id, thread] : threads_)
    if (thread.name != kNavigation) all += thread.now - thread.begin;
  return all;
}

double WaitedForCpu::ofNavigation() const {
  double all = 0;
  for (const auto& [id, thread] : threads_)
    if (thread.name == kNavigation) all += thread.now;
  return all;
}

void WaitedForCpu::begin() {
  for (auto& [id, thread] : threads_) thread.begin = thread.now;
}

VehicleProcess::VehicleProcess(const VehiclePlaces& places, std::function<void()> prepare)
    : places_(places),
      prepare_(std::move(prepare)),
      clock_(rt::VehicleClock::systemOffsetNs(), kRate),
      seen_(places.seen()),
      notify_name_("fathom-faults-" + std::to_string(::getpid())) {
  seen_->clock = clock_.setting();
  notify_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path + 1, notify_name_.c_str(), sizeof address.sun_path - 2);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + notify_name_.size());
  require(notify_ >= 0 && ::bind(notify_, reinterpret_cast<const sockaddr*>(&address), size) == 0, "socket");
  start();
}

VehicleProcess::~VehicleProcess() {
  if (pid_ > 0) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  ::close(notify_);
}

// Forked, so that it need not be linked again: this process has no other thread.
void VehicleProcess::start() {
  std::fflush(nullptr);
  pid_ = ::fork();
  require(pid_ >= 0, "fork");
  last_sign_ns_ = machineNs();
  armed_ = killed_ = false;
  if (pid_ > 0) return;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::setenv("NOTIFY_SOCKET", ("@" + notify_name_).c_str(), 1);
  prepare_();
  int status = kExitFailedWork;
  try {
    status = runVehicle(places_);
  } catch (const std::exception& e) {
    std::printf("%s\n", e.what());
  }
  std::fflush(nullptr);
  std::_Exit(status);
}

void VehicleProcess::readSigns() {
  std::array<char, 4096> text;
  for (ssize_t size = 0; (size = ::recv(notify_, text.data(), text.size(), 0)) > 0;)
    if (std::string_view(text.data(), static_cast<std::size_t>(size)).find("WATCHDOG=1") != std::string::npos)
      last_sign_ns_ = machineNs();
}

void VehicleProcess::look() {
  readSigns();
  const std::int64_t now_ns = machineNs();
  if (pid_ < 0) {
    if (start_at_ns_ != 0 && now_ns >= start_at_ns_) start();
    return;
  }
  waited_.look(::getpid());
  waited_.look(pid_);
  if (const pid_t mapper = seen_->mapper; mapper > 0) waited_.look(mapper);
  if (!armed_ && seen_->lives > lives_) {
    armed_ = true;
    lives_ = seen_->lives;
    last_sign_ns_ = now_ns;
    if (!away_.empty()) away_.back().to_ns = seen_->armed_utc_ns;
  }
  if (!killed_ && !seen_->end && now_ns - last_sign_ns_ > (armed_ ? kWatchdog_ns : kStart_ns)) {
    killed_ = true;
    ::kill(pid_, SIGKILL);
  }
  int status = 0;
  if (::waitpid(pid_, &status, WNOHANG) != pid_) return;
  pid_ = -1;
  const std::string how = WIFSIGNALED(status)
                              ? (killed_ ? "killed by the watchdog" : ::strsignal(WTERMSIG(status)))
                              : "exit status " + std::to_string(WEXITSTATUS(status));
  if (WIFEXITED(status) && (WEXITSTATUS(status) == 0 || seen_->ended)) return;  // it is not started again
  away_.push_back({clock_.utcNs(), 0, how});
  start_at_ns_ = now_ns + kRestart_ns;
}

}  // namespace fathom::test
