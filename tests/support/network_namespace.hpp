#pragma once

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

namespace fathom::test {

// Runs a command line of `ip`; false when it fails. Its output is dropped.
inline bool ip(const std::string& arguments) {
  return std::system(("ip " + arguments + " >/dev/null 2>&1").c_str()) == 0;
}

// Puts this thread, and the threads and processes that it starts from now on, into a network of its own that
// nobody else sees and that is gone when they are. Call it before any thread is started. Empty, or why it
// cannot be had: say so with GTEST_SKIP.
[[nodiscard]] inline std::string ownNetwork() {
  if (::unshare(CLONE_NEWNET) != 0)
    return std::string("no network namespace: ") + std::strerror(errno) +
           "; run as root or with CAP_SYS_ADMIN";
  if (!ip("link set lo up")) return "no `ip` command: install iproute2";
  return "";
}

// A program in a network of its own, joined to ours by a cable: a veth pair that carries packets of 9000
// bytes. Our end is the interface linkName(n) with ownAddress(n), its end has deviceAddress(n). Ended at
// destruction, with its network.
class NamespacedProcess {
 public:
  static std::string linkName(int n) { return "dev" + std::to_string(n); }
  static std::string ownAddress(int n) { return "10.77." + std::to_string(n) + ".1"; }
  static std::string deviceAddress(int n) { return "10.77." + std::to_string(n) + ".2"; }

  // Starts argv[0] with these arguments once the cable is there; its output goes to the file `output`.
  NamespacedProcess(int n, std::vector<std::string> argv, const std::string& output = "/dev/null") : n_(n) {
    int there[2], go[2];
    if (::pipe2(there, O_CLOEXEC) != 0 || ::pipe2(go, O_CLOEXEC) != 0) return;
    pid_ = ::fork();
    if (pid_ == 0) child(n, argv, output, there[1], go[0]);
    ::close(there[1]);
    ::close(go[0]);
    char byte = 0;
    if (pid_ > 0 && ::read(there[0], &byte, 1) == 1) {
      connected_ = ip("link add " + linkName(n) + " mtu 9000 type veth peer name eth0 mtu 9000 netns " +
                      std::to_string(pid_)) &&
                   ip("addr add " + ownAddress(n) + "/24 dev " + linkName(n)) &&
                   ip("link set " + linkName(n) + " up");
      if (connected_) connected_ = ::write(go[1], "g", 1) == 1;
    }
    ::close(there[0]);
    ::close(go[1]);
  }
  ~NamespacedProcess() { stop(SIGKILL); }
  NamespacedProcess(const NamespacedProcess&) = delete;
  NamespacedProcess& operator=(const NamespacedProcess&) = delete;

  [[nodiscard]] bool connected() const { return connected_; }
  // Pulls the cable, or puts it back.
  void unplug() const { (void)ip("link set " + linkName(n_) + " down"); }
  void plug() const { (void)ip("link set " + linkName(n_) + " up"); }
  // Ends it; its exit status, or -1 when a signal ended it.
  int stop(int signal = SIGTERM) {
    if (pid_ <= 0) return -1;
    ::kill(pid_, signal);
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    // The cable goes with the network at its other end, but only some time after.
    (void)ip("link del " + linkName(n_));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  [[noreturn]] static void child(int n, const std::vector<std::string>& argv, const std::string& output,
                                 int there, int go) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    char byte = 0;
    if (::unshare(CLONE_NEWNET) != 0 || ::write(there, "t", 1) != 1 || ::read(go, &byte, 1) != 1)
      ::_exit(126);
    if (!ip("link set lo up") || !ip("addr add " + deviceAddress(n) + "/24 dev eth0 broadcast +") ||
        !ip("link set eth0 up"))
      ::_exit(126);
    const int file = ::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    ::dup2(file, STDOUT_FILENO);
    ::dup2(file, STDERR_FILENO);
    std::vector<char*> arguments;
    for (const std::string& argument : argv) arguments.push_back(const_cast<char*>(argument.c_str()));
    arguments.push_back(nullptr);
    ::execvp(arguments[0], arguments.data());
    ::_exit(127);
  }

  int n_;
  pid_t pid_ = -1;
  bool connected_ = false;
};

}  // namespace fathom::test
