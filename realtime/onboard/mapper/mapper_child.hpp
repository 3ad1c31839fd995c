#pragma once

#include <sys/types.h>

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fathom::onboard {

// The mapper process: starts it without a copy of this process' pages (posix_spawn), detects its end, kills
// it. Used by one thread.
class MapperChild {
 public:
  struct Start {
    std::filesystem::path program;
    std::vector<std::string> arguments;
    // Become its files kMapperDownFile and on. Nothing else that this process has open is handed on.
    std::array<int, 4> files{};
  };
  explicit MapperChild(Start start);
  // Kills it.
  ~MapperChild();
  MapperChild(const MapperChild&) = delete;
  MapperChild& operator=(const MapperChild&) = delete;

  // "", or why it could not be started.
  [[nodiscard]] std::string start();
  [[nodiscard]] bool running() const { return pid_ > 0; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  // Processor time of all its threads so far; 0 if it does not run.
  [[nodiscard]] std::int64_t cpuNs() const;
  // How it ended, once: "exit status 1", "signal 11 (Segmentation fault)". Does not wait.
  [[nodiscard]] std::optional<std::string> ended();
  // With SIGKILL; ended() reports it afterwards.
  void kill();

 private:
  Start start_;
  pid_t pid_ = -1;
};

}  // namespace fathom::onboard
