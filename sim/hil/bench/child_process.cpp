#include "sim/hil/bench/child_process.hpp"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace fathom::sim {

bool ipCommand(const std::string& arguments) {
  return std::system(("ip " + arguments + " >/dev/null 2>&1").c_str()) == 0;
}

std::string enterOwnNetwork() {
  if (std::system("ip -V >/dev/null 2>&1") != 0) return "there is no `ip` command: install iproute2";
  if (::unshare(CLONE_NEWNET) != 0)
    return std::string("no network namespace (") + std::strerror(errno) +
           "): run as root, or with CAP_SYS_ADMIN";
  if (!ipCommand("link set lo up multicast on") || !ipCommand("route add 224.0.0.0/4 dev lo"))
    return "the loopback of a new network namespace cannot be set up";
  return "";
}

bool Cable::connectNearEnd(pid_t child) const {
  return ipCommand("link add " + nearName() + " mtu 9000 type veth peer name eth0 mtu 9000 netns " +
                   std::to_string(child)) &&
         ipCommand("addr add " + nearAddress() + "/24 broadcast + dev " + nearName()) &&
         ipCommand("link set " + nearName() + " up");
}

bool Cable::connectFarEnd() const {
  return ipCommand("link set lo up") && ipCommand("addr add " + farAddress() + "/24 broadcast + dev eth0") &&
         ipCommand("link set eth0 up");
}

namespace {

constexpr int kNotStarted = 126;
constexpr double kGraceSeconds = 5;  // between SIGTERM and SIGKILL

using Seconds = std::chrono::duration<double>;

// A pipe on which one process releases the other.
struct Gate {
  Gate() {
    if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe to a child process");
  }
  ~Gate() {
    for (const int end : ends)
      if (end >= 0) ::close(end);
  }
  Gate(const Gate&) = delete;
  Gate& operator=(const Gate&) = delete;
  void close(std::size_t end) {
    ::close(ends[end]);
    ends[end] = -1;
  }
  [[nodiscard]] bool open() const { return ::write(ends[1], "", 1) == 1; }
  [[nodiscard]] bool pass() const {
    char byte = 0;
    return ::read(ends[0], &byte, 1) == 1;
  }
  std::array<int, 2> ends = {-1, -1};
};

[[noreturn]] void runProgram(const ChildProcess::Options& options, char* const argv[]) {
  const int file = ::open(options.output.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND, 0644);
  if (file < 0) ::_exit(kNotStarted);
  ::dup2(file, STDOUT_FILENO);
  ::dup2(file, STDERR_FILENO);
  for (const std::string& variable : options.environment) {
    const std::size_t equals = variable.find('=');
    ::setenv(variable.substr(0, equals).c_str(), variable.c_str() + equals + 1, 1);
  }
  // A terminal's interrupt must reach the bench alone, which ends its children in order.
  ::setpgid(0, 0);
  ::execvp(argv[0], argv);
  ::_exit(kNotStarted);
}

}  // namespace

ChildProcess::ChildProcess(const Options& options) : output_(options.output) {
  Gate there, go;
  const pid_t bench = ::getpid();
  // Built before vfork(): the child must not allocate in the shared memory.
  std::vector<char*> argv;
  for (const std::string& argument : options.argv) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  // fork() write-protects this process's pages, on which its real-time threads would fault; vfork() is used
  // where the child changes no memory.
  // NOLINTNEXTLINE(clang-analyzer-security.insecureAPI.vfork)
  pid_ = options.cable || !options.environment.empty() ? ::fork() : ::vfork();
  if (pid_ < 0) throw std::runtime_error("no child process for " + options.argv.front());
  if (pid_ == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != bench) ::_exit(kNotStarted);
    if (options.cable) {
      there.close(0);
      go.close(1);
      if (::unshare(CLONE_NEWNET) != 0 || !there.open() || !go.pass()) ::_exit(kNotStarted);
      if (!options.cable->connectFarEnd()) ::_exit(kNotStarted);
    }
    runProgram(options, argv.data());
  }
  there.close(1);
  go.close(0);
  if (!options.cable) return;
  if (there.pass() && options.cable->connectNearEnd(pid_) && go.open()) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
  throw std::runtime_error("no network of its own for " + options.argv.front());
}

ChildProcess::~ChildProcess() {
  if (!running()) return;
  signal(SIGTERM);
  if (wait(kGraceSeconds)) return;
  signal(SIGKILL);
  (void)wait(kGraceSeconds);
}

bool ChildProcess::running() {
  return !wait(0).has_value();
}

void ChildProcess::signal(int number) {
  if (!status_) ::kill(pid_, number);
}

std::optional<int> ChildProcess::wait(double seconds) {
  const auto end = std::chrono::steady_clock::now() + Seconds(seconds);
  while (!status_) {
    int status = 0;
    const pid_t ended = ::waitpid(pid_, &status, WNOHANG);
    if (ended == pid_)
      status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    else if (ended < 0 && errno != EINTR)
      status_ = kNotStarted;
    if (status_ || std::chrono::steady_clock::now() >= end) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return status_;
}

bool ChildProcess::waitForLine(const std::string& text, double seconds, const std::atomic<bool>& stop) {
  const auto end = std::chrono::steady_clock::now() + Seconds(seconds);
  while (!stop) {
    const bool ended = !running();  // before the file is read: its last lines count
    std::ifstream file(output_);
    for (std::string line; std::getline(file, line);)
      if (!file.eof() && line.compare(0, text.size(), text) == 0) return true;
    if (ended || std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

}  // namespace fathom::sim
