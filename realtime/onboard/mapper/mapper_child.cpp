#include "realtime/onboard/mapper/mapper_child.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

#include "realtime/base/units.hpp"
#include "realtime/onboard/mapper/mapper_channel.hpp"

extern char** environ;

namespace fathom::onboard {
namespace {

constexpr int kFirstFile = kMapperDownFile;
constexpr int kBeyondAll = 64;  // numbers that those of the child cannot collide with

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

}  // namespace fathom::onboard
