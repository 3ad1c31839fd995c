#include "realtime/onboard/mapper/mapper_keeper.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {

constexpr int kFirstFile = kMapperDownFile;
constexpr int kBeyondAll = 64;  // numbers that those of the child cannot collide with

constexpr std::int64_t kWorks_ns =
    50'000'000;  // what a process works that only waits takes minutes to come to

}  // namespace

MapperChild::MapperChild(Start start) : start_(std::move(start)) {
  for (int& file : start_.files) file = ::fcntl(file, F_DUPFD_CLOEXEC, kBeyondAll);
}

MapperChild::~MapperChild() {
  if (running()) {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  for (const int file : start_.files) ::close(file);
}

std::string MapperChild::start() {
  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&files);
  ::posix_spawnattr_init(&attributes);
  int number = kFirstFile;
  for (const int file : start_.files) ::posix_spawn_file_actions_adddup2(&files, file, number++);
  ::posix_spawn_file_actions_addclosefrom_np(&files, number);
  sigset_t none, all;
  ::sigemptyset(&none);
  ::sigfillset(&all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  // A group of its own: what the terminal sends to this one (Ctrl-C) is not for it.
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(&attributes,
                             POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> arguments;
  std::string name = "fathom-onboard";  // whatever the path that leads to it
  arguments.push_back(name.data());
  for (std::string& argument : start_.arguments) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  // Its heap in large pages: hundreds of megabytes are there in a fraction of the time.
  std::string large_pages = "GLIBC_TUNABLES=glibc.malloc.hugetlb=1";
  std::vector<char*> environment = {large_pages.data()};
  for (char** variable = environ; *variable != nullptr; ++variable)
    if (!std::string_view(*variable).starts_with("GLIBC_TUNABLES=")) environment.push_back(*variable);
  environment.push_back(nullptr);
  const int failed =
      ::posix_spawn(&pid_, start_.program.c_str(), &files, &attributes, arguments.data(), environment.data());
  ::posix_spawn_file_actions_destroy(&files);
  ::posix_spawnattr_destroy(&attributes);
  if (failed == 0) return "";
  pid_ = -1;
  return start_.program.string() + ": " + std::strerror(failed);
}

std::optional<std::string> MapperChild::ended() {
  int status = 0;
  if (!running() || ::waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
  pid_ = -1;
  if (WIFSIGNALED(status))
    return "signal " + std::to_string(WTERMSIG(status)) + " (" + ::strsignal(WTERMSIG(status)) + ")";
  return "exit status " + std::to_string(WEXITSTATUS(status));
}

std::int64_t MapperChild::cpuNs() const {
  clockid_t clock{};
  timespec worked{};
  if (!running() || ::clock_getcpuclockid(pid_, &clock) != 0 || ::clock_gettime(clock, &worked) != 0)
    return 0;
  return worked.tv_sec * kSecond_ns + worked.tv_nsec;
}

void MapperChild::kill() {
  if (running()) ::kill(pid_, SIGKILL);
}

void MapperKeeper::learnFrom(const Seen& seen, Orders& orders) {
  orders.lost = true;
  const bool further = seen.position > furthest_;
  furthest_ = std::max(furthest_, seen.position);
  futile_ = further ? 0 : futile_ + 1;
  if (seen.phase == MapperPhase::kLoading && seen.loading != 0) orders.avoid = seen.loading;
  const bool follows = seen.phase == MapperPhase::kCatchingUp || seen.phase == MapperPhase::kRunning;
  const std::uint64_t pair = follows ? seen.working_pair : 0;
  if (pair != 0 && pair == died_on_pair_) {
    orders.drop_pair = static_cast<std::uint32_t>(pair - 1);
    died_on_pair_ = 0;
  } else {
    died_on_pair_ = pair;
  }
  const std::int64_t doubled = config_.first_wait_ns << std::min(futile_ - 1, 20);
  const std::int64_t wait = futile_ == 0 ? 0 : std::min(doubled, config_.longest_wait_ns);
  // One that found what a person must put right is not asked ten times a second.
  const bool refused = seen.phase == MapperPhase::kRefused && !killed_;
  next_start_ns_ = seen.now_ns + (refused ? config_.longest_wait_ns / 3 : wait);
}

MapperKeeper::Orders MapperKeeper::step(const Seen& seen) {
  Orders orders;
  if (done_) return orders;
  if (seen.running) {
    const bool finishes = seen.phase == MapperPhase::kFinishing;
    // That of a process that is gone, or nonsense: it has so long to be gone.
    const bool over = seen.phase >= MapperPhase::kEnded;
    const bool works = finishes && seen.cpu_ns - cpu_ns_ >= kWorks_ns;
    if (seen.phase != phase_ || (!over && seen.beats != beats_) || works) {
      last_life_ns_ = seen.now_ns;
      cpu_ns_ = seen.cpu_ns;
    }
    beats_ = seen.beats;
    phase_ = seen.phase;
    if (killed_) return orders;
    const bool follows = seen.phase == MapperPhase::kCatchingUp || seen.phase == MapperPhase::kRunning;
    const std::int64_t limit = follows || over ? config_.stuck_after_ns : config_.start_within_ns;
    if (seen.now_ns - last_life_ns_ <= limit) return orders;
    orders.kill = killed_ = true;
    orders.why = "the mapper got no further for " + std::to_string(limit / 1'000'000) + " ms";
    return orders;
  }
  if (was_running_) {
    was_running_ = false;
    if (seen.phase == MapperPhase::kEnded || seen.phase == MapperPhase::kNoMap) {
      done_ = true;
      return orders;
    }
    learnFrom(seen, orders);
    killed_ = false;
  }
  if (seen.now_ns < next_start_ns_) return orders;
  orders.start = true;
  orders.from_empty = futile_ >= config_.futile_starts;
  if (orders.from_empty) futile_ = 0;
  ++starts_;
  // One that does not come to be has died at once.
  was_running_ = true;
  last_life_ns_ = seen.now_ns;
  return orders;
}

}  // namespace fathom::onboard
