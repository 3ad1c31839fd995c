#include "realtime/onboard/replay_command.hpp"

#include <cstdio>
#include <memory>

#include "firmware_if/devices/device_address.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::onboard {

void ReplayCommand::addOptions(CLI::App& app, CLI::Option* replay) {
  app.add_option("--out", out_, "Folder to write; default: MISSION/onboard")->needs(replay);
  app.add_option("--modem", modem_, "Send and receive frames: udp:HOST:PORT or serial:DEVICE:BAUD")
      ->needs(replay);
  app.add_option("--downlink", downlink_, "Receive these frames instead: downlink.bin of an earlier run");
  app.add_option("--speed", options_.link.speed,
                 "With --modem: mission seconds a second; 0: as fast as it goes")
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--drain", options_.drain_s,
                 "Go on sending after the last sample, at most so many mission seconds")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--no-slam", options_.no_slam, "Dead reckoning only: no visual odometry, no loop closures");
}

int ReplayCommand::run(const std::string& mission, const std::string& config) {
  options_.mission = mission;
  if (!config.empty()) options_.config = config;
  if (!out_.empty()) options_.out = out_;
  const auto port = modem_.empty() ? nullptr : io::openFramePort(modem_, "--modem " + modem_);
  if (port && !port->isOpen()) throw InputError("--modem " + modem_, "", std::string(port->reason()));
  options_.link.modem = port.get();
  if (!downlink_.empty()) options_.link.downlink = downlink_;
  const ReplaySummary summary = replay(options_);
  if (!summary.warning.empty()) std::fprintf(stderr, "warning: %s\n", summary.warning.c_str());
  std::printf("%s\n", describe(summary).c_str());
  return kExitSuccess;
}

}  // namespace fathom::onboard
