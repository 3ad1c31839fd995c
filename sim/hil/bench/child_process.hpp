#pragma once

#include <sys/types.h>

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fathom::sim {

// Runs a command of `ip` (iproute2) without output; false when it fails.
[[nodiscard]] bool ipCommand(const std::string& arguments);

// Moves this process and its later children into a network namespace of their own, with a loopback that
// carries multicast (LCM); it ends with the last process in it. To be called before any thread is started.
// Empty, or the reason of a failure.
[[nodiscard]] std::string enterOwnNetwork();

// A cable (veth pair, packets of 9000 bytes) from the bench's network to that of one child.
class Cable {
 public:
  explicit Cable(int number) : number_(number) {}
  [[nodiscard]] std::string nearName() const { return "camera" + std::to_string(number_); }
  [[nodiscard]] std::string nearAddress() const { return "10.77." + std::to_string(number_) + ".1"; }
  [[nodiscard]] std::string farAddress() const { return "10.77." + std::to_string(number_) + ".2"; }
  [[nodiscard]] bool connectNearEnd(pid_t child) const;  // in the bench, while the child waits in its network
  [[nodiscard]] bool connectFarEnd() const;              // then in the child

 private:
  int number_;
};

// A child program: terminated and waited for at destruction; killed by the system when the bench dies.
class ChildProcess {
 public:
  struct Options {
    std::vector<std::string> argv;
    std::vector<std::string> environment;  // NAME=value, beside the bench's own
    std::filesystem::path output;          // its stdout and stderr
    // With a cable: a network of its own, connected to the bench's.
    std::optional<Cable> cable;
  };
  // Throws std::runtime_error when it cannot be started.
  explicit ChildProcess(const Options& options);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  [[nodiscard]] bool running();
  void signal(int number);
  // Waits until it has ended; its exit status (128 + the signal that ended it), std::nullopt while it runs.
  std::optional<int> wait(double seconds);
  // Waits until a line of its output begins with `text`; false after its end, a timeout or `stop`.
  bool waitForLine(const std::string& text, double seconds, const std::atomic<bool>& stop);
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::filesystem::path output_;
};

}  // namespace fathom::sim
