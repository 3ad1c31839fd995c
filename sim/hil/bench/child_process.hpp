#pragma once

#include <sys/types.h>

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sim/hil/bench/bench_network.hpp"

namespace fathom::sim {

// A program that the bench starts: told to end, and waited for, at destruction; killed by the system when the
// bench dies.
class ChildProcess {
 public:
  struct Options {
    std::vector<std::string> argv;
    std::vector<std::string> environment;  // NAME=value, beside the bench's own
    std::filesystem::path output;          // its stdout and stderr
    // Puts it into a network of its own, joined to the bench's by this cable.
    std::optional<Cable> cable;
  };
  // Throws std::runtime_error when it cannot be started.
  explicit ChildProcess(const Options& options);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  [[nodiscard]] bool running();
  void signal(int number);
  // Waits until it has ended; its exit status (128 + the signal that ended it), std::nullopt when it has not.
  std::optional<int> wait(double seconds);
  // Waits until a line of its output begins with `text`; false when it ended, the time is over, or `stop`.
  bool waitForLine(const std::string& text, double seconds, const std::atomic<bool>& stop);
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  std::filesystem::path output_;
};

}  // namespace fathom::sim
