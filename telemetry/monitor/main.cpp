#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <string>

#include "realtime/base/command_line.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/version.hpp"
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
  fathom::monitor::MonitorOptions options;
  CLI::App app(
      "Watches a dive over the acoustic link: rebuilds its map and track and serves them as a web page.");
  app.footer(
      "Examples: fathom-monitor --packets missions/reef-grid/onboard/packets.bin --http 8080\n"
      "          fathom-monitor --serial /dev/ttyUSB0 --baud 9600 --vehicle 1 --dive 1 --key dive.key --out "
      "dive-1");
  app.add_option("--udp", options.udp_port, "receive frames on this UDP port (stand-in for the modem)");
  app.add_option("--bind", options.bind_address, "address of the UDP port")->capture_default_str();
  app.add_option("--serial", options.serial_device, "receive frames from a modem on this serial device");
  app.add_option("--baud", options.baud, "rate of the serial line [bit/s]")->capture_default_str();
  app.add_option("--packets", options.packets, "read recorded frames (onboard/packets.bin) instead");
  app.add_option("--speed", options.speed, "play them so many times as fast as they were sent; 0: at once")
      ->capture_default_str();
  app.add_option("--vehicle", options.vehicle,
                 "vehicle id to admit, with --dive (default: the first one received)");
  app.add_option("--dive", options.dive, "dive id to admit");
  app.add_option("--http", options.http_port, "port of the web page; 0: any free one")->capture_default_str();
  app.add_option("--http-bind", options.http_address,
                 "address of the web page; other than loopback needs a token")
      ->capture_default_str();
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
  CLI::App* key =
      app.add_subcommand("key", "make a key for the downlink; the vehicle gets a copy of the file");
  key->footer("Example: fathom-monitor key dive.key");
  key->add_option("file", key_file, "to make; one that exists is left alone")->required();
  fathom::monitor::CodecOptions codec_options;
  CLI::App* codec = fathom::monitor::addCodecCommand(app, codec_options);
  app.set_version_flag("--version", fathom::versionLine("fathom-monitor"));
  if (const auto code = fathom::parseCommandLine("fathom-monitor", app, argc, argv)) return *code;
  return fathom::runTool("fathom-monitor", [&]() -> int {
    if (*codec) return fathom::monitor::runCodec(codec_options);
    if (*key) {
      fathom::telemetry::makeLinkKey(key_file);
      return fathom::kExitSuccess;
    }
    std::signal(SIGINT, onSignal);
    std::signal(SIGTERM, onSignal);
    return fathom::monitor::runMonitor(options, g_stop);
  });
}
