// fathom-sensors: checks hardware before a dive and decodes captures.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <memory>

#include "firmware_if/devices/capture_commands.hpp"
#include "firmware_if/predive/predive_command.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/frame.hpp"
#include "telemetry/wire/uplink_messages.hpp"

namespace {

using namespace fathom;

// Reads the ship's frames for this vehicle on this dive, with the same rules as fathom-onboard, and writes a
// status that gives the ship the turn. Its versions are below the dive's first, where fathom-onboard begins,
// so that the ship does not take that program's frames for repeated ones. `padded_bytes`: size of modem
// frames that are always full; 0: not padded.
io::PrediveLink makeLink(const io::MissionConfig& mission, const std::optional<telemetry::LinkKey>& key,
                         std::size_t padded_bytes) {
  const telemetry::LinkIdentity identity{mission.vehicle_id, mission.dive_id};
  const auto receiver = std::make_shared<telemetry::DownlinkReceiver>(identity, key, 0);
  io::PrediveLink link;
  link.read = [receiver](std::span<const std::uint8_t> modem_frame) {
    io::PrediveLink::Received received;
    telemetry::LinkFrames frames(modem_frame);
    while (const auto frame = frames.next()) {
      const auto result = receiver->accept(0, *frame);
      received.ours = received.ours || result.verdict == telemetry::DownlinkVerdict::kAccepted ||
                      result.verdict == telemetry::DownlinkVerdict::kNoKey;
      if (const auto& fix = result.content.fix)
        received.fix = UsblFix{
            fix->utc_ns, fix->utc_ns, fix->latitude * kRadiansPerDegree, fix->longitude * kRadiansPerDegree,
            fix->depth,  fix->sigma};
    }
    return received;
  };
  constexpr telemetry::Version kGreetings = 0x100;
  link.greet = [identity, padded_bytes, tag = telemetry::FrameTag(key),
                version = telemetry::firstVersion(mission.start_utc_ns) - kGreetings](
                   std::int64_t utc_ns, std::span<std::uint8_t> out) mutable {
    telemetry::Status status;
    status.utc_ns = utc_ns;
    status.health = telemetry::kHealthNoFix;
    std::array<std::uint8_t, telemetry::kMinFrameBytes> payload;
    const std::size_t size = telemetry::encodeStatus(status, payload);
    const bool padded = padded_bytes > 0;
    telemetry::ModemFrameWriter modem(padded ? out.first(padded_bytes) : out, padded);
    modem.add(telemetry::encodeFrame({identity, version++, telemetry::MessageType::kStatus, true},
                                     {payload.data(), size}, modem.room(), tag));
    return modem.finish();
  };
  return link;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine app("Checks a vehicle's devices before a dive and decodes captures of its sensors.",
                  "Example: fathom-sensors predive dives/today --config onboard.toml\n"
                  "         fathom-sensors dvl dive.pd0 --csv > dive.csv\n");

  io::DvlCommand dvl;
  CommandLine& dvl_command = app.command("dvl", "RDI PD0 ensembles with bottom track",
                                         "Example: fathom-sensors dvl dive.pd0 --csv > dive.csv\n",
                                         [&] { return io::runDvlCommand(dvl, stdout, stderr); });
  dvl_command.add_option("FILE", dvl.file, "PD0 capture")->required();
  dvl_command.add_flag("--csv", dvl.csv,
                       "A row per ensemble instead of a summary; absent values are empty fields");

  io::CanCommand can;
  CommandLine& can_command = app.command("can", "NMEA 2000 messages of a CAN capture",
                                         "Example: fathom-sensors can candump.log --json > can.jsonl\n",
                                         [&] { return io::runCanCommand(can, stdout, stderr); });
  can_command
      .add_option("FILE", can.file,
                  "text of candump, canboat (plain), Yacht Devices (RAW) or Actisense (N2K ASCII), or a "
                  "mission's sensors.lcmlog")
      ->required();
  can_command.add_flag("--json", can.json,
                       "One JSON object a message instead of a summary; absent values are left out");

  io::PrediveCommand predive;
  CommandLine& predive_command = app.command(
      "predive", "Checks every device before the launch: green or red",
      "Exit status 0: no row is red. Example: fathom-sensors predive dives/today --config onboard.toml\n",
      [&] {
        predive.colours = ::isatty(STDOUT_FILENO) == 1 && std::getenv("NO_COLOR") == nullptr;
        const auto make_link = [&](const io::MissionConfig& mission, const ConfigTable& table) {
          const std::filesystem::path key_file = table.text("key_file", "");
          std::optional<telemetry::LinkKey> key;
          std::string warning;
          if (!key_file.empty())
            key = telemetry::readLinkKey(predive.config.parent_path() / key_file, warning);
          const auto modem_bytes = static_cast<std::size_t>(table.integer("modem_bytes", 0, 0, 2048));
          return makeLink(mission, key, table.boolean("padded", false) ? modem_bytes : 0);
        };
        return io::runPrediveCommand(predive, make_link, stdout);
      });
  predive_command.add_option("FOLDER", predive.folder, "Mission folder with mission.toml and stereo.calib")
      ->required();
  predive_command.add_option("--config", predive.config, "onboard.toml of the dive")->required();
  predive_command.shown("--seconds", predive.seconds, "Time for which the devices are checked [s]", 0.1,
                        3600.0);
  predive_command.add_flag("--json", predive.json, "One JSON object instead of the table");
  return app.run("fathom-sensors", argc, argv, versionLine("fathom-sensors"));
}
