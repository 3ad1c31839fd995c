#include <atomic>
#include <csignal>
#include <string>

#include "realtime/base/command_line.hpp"
#include "telemetry/monitor/codec/codec_program.hpp"
#include "telemetry/monitor/monitor_program.hpp"
#include "telemetry/wire/link_key.hpp"

namespace {
std::atomic<bool> g_stop{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set from a signal handler");
void onSignal(int) {
  g_stop = true;
}
}  // namespace

int main(int argc, char** argv) {
  using namespace fathom;
  monitor::MonitorOptions options;
  CommandLine app(
      "Watches a dive over the acoustic link: rebuilds its map and track and serves them as a web page.",
      "Examples: fathom-monitor --packets missions/reef-grid/onboard/packets.bin --http 8080\n"
      "          fathom-monitor --serial /dev/ttyUSB0 --baud 9600 --vehicle 1 --dive 1 --key dive.key --out "
      "dive-1",
      [&options] {
        std::signal(SIGINT, onSignal);
        std::signal(SIGTERM, onSignal);
        return monitor::runMonitor(options, g_stop);
      });
  app.add_option("--udp", options.udp_port, "receive frames on this UDP port (stand-in for the modem)");
  app.shown("--bind", options.bind_address, "address of the UDP port");
  app.add_option("--serial", options.serial_device, "receive frames from a modem on this serial device");
  app.shown("--baud", options.baud, "rate of the serial line [bit/s]");
  app.add_option("--packets", options.packets, "read recorded frames (onboard/packets.bin) instead");
  app.shown("--speed", options.speed, "play them so many times as fast as they were sent; 0: at once");
  app.add_option("--vehicle", options.vehicle,
                 "vehicle id to admit, with --dive (default: the first one received)");
  app.add_option("--dive", options.dive, "dive id to admit");
  app.shown("--http", options.http_port, "port of the web page; 0: any free one");
  app.shown("--http-bind", options.http_address,
            "address of the web page; other than loopback needs a token");
  app.add_flag("--listen", options.listen,
               "send nothing: of all programs that receive a vehicle, one may send to it");
  app.add_option("--key", options.key, "file of the key that signs requests to the vehicle");
  app.add_option(
      "--token-file", options.token_file,
      "file of the secret that the web page asks for, 8 to 128 letters, digits, - or _ (default: none on "
      "loopback, else a new one is printed)");
  app.add_option("--page", options.page,
                 "folder of the page (default: ../share/fathom/monitor from the program)");
  app.add_option(
      "--out", options.out,
      "keep received frames, frames.log and the exports in this folder; a restart continues from there");
  app.add_option("--exit-after-idle", options.exit_after_idle_s,
                 "exit when no frame has come for so long [s]");
  std::string key_file;
  app.command("key", "make a key for the downlink; the vehicle gets a copy of the file",
              "Example: fathom-monitor key dive.key",
              [&key_file] {
                telemetry::makeLinkKey(key_file);
                return kExitSuccess;
              })
      .add_option("file", key_file, "to make; one that exists is left alone")
      ->required();
  monitor::addCodecCommand(app);
  return app.run("fathom-monitor", argc, argv, versionLine("fathom-monitor"));
}
