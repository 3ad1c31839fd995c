#pragma once

#include <string>

namespace fathom::rt {

// Notifies the system's service manager (sd_notify). Without a service manager every call does nothing. Part
// of the library fathom_service, the only one that needs libsystemd.
class ServiceNotify {
 public:
  // READY=1: armed.
  static void ready(const std::string& status) noexcept;
  // STATUS=: one line that `systemctl status` shows.
  static void status(const std::string& status) noexcept;
  // WATCHDOG=1: the vital tiers are alive.
  static void alive() noexcept;
  static void stopping() noexcept;
  // A service manager keeps the program: when it fails, it is started again.
  [[nodiscard]] static bool kept() noexcept;
};

}  // namespace fathom::rt
