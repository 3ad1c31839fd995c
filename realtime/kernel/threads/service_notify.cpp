#include "realtime/kernel/threads/service_notify.hpp"

#include <systemd/sd-daemon.h>

#include <cstdlib>

namespace fathom::rt {
namespace {

constexpr int kKeepEnvironment = 0;

// A status is one line, and anything behind a line end would be a message of its own.
std::string oneLine(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  return text;
}

}  // namespace

void ServiceNotify::ready(const std::string& status) noexcept {
  ::sd_notify(kKeepEnvironment, ("READY=1\nSTATUS=" + oneLine(status)).c_str());
}
void ServiceNotify::status(const std::string& status) noexcept {
  ::sd_notify(kKeepEnvironment, ("STATUS=" + oneLine(status)).c_str());
}
void ServiceNotify::alive() noexcept {
  ::sd_notify(kKeepEnvironment, "WATCHDOG=1");
}
void ServiceNotify::stopping() noexcept {
  ::sd_notify(kKeepEnvironment, "STOPPING=1");
}

bool ServiceNotify::kept() noexcept {
  return std::getenv("NOTIFY_SOCKET") != nullptr;
}

}  // namespace fathom::rt
