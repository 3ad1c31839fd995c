#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>

#include "telemetry/wire/frame.hpp"

namespace fathom::monitor {

struct MonitorOptions {
  std::optional<int> udp_port;
  std::string bind_address = "127.0.0.1";  // of the UDP port
  std::string serial_device;
  int baud = 9600;
  std::filesystem::path packets;  // a recorded packets.bin instead of a port
  double speed = 0;               // of the recording; 0: as fast as it can be read
  std::optional<int> vehicle, dive;
  int http_port = 8080;  // 0: any free one
  std::string http_address = "127.0.0.1";
  bool listen = false;               // sends nothing to the vehicle: another program does
  std::filesystem::path key;         // the vehicle's key; empty: no requests can be sent
  std::filesystem::path token_file;  // file of the page's token; empty: none on loopback, else a new one
  std::filesystem::path page;        // empty: ../share/fathom/monitor beside the executable's folder
  std::filesystem::path out;         // empty: nothing is saved, and a restart has an empty map
  std::optional<double> exit_after_idle_s;
};

// Receives, serves and saves until `stop` is set, or nothing has come for exit_after_idle_s (of a recording:
// since its end). Returns the exit code; throws InputError for options or inputs that cannot be used.
int runMonitor(const MonitorOptions& options, const std::atomic<bool>& stop);

}  // namespace fathom::monitor
