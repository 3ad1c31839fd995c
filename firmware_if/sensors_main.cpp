// fathom-sensors: checks hardware before a dive and decodes captures.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <memory>

#include "firmware_if/devices/capture_commands.hpp"
#include "firmware_if/predive/predive_command.hpp"
#include "realtime/base/command_line.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/base/version.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/bundle.hpp"
#include "telemetry/wire/status.hpp"

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
  CLI::App app{"Checks a vehicle's devices before a dive and decodes captures of its sensors."};
  app.footer(
      "Example: fathom-sensors predive dives/today --config onboard.toml\n"
      "         fathom-sensors dvl dive.pd0 --csv > dive.csv\n");
  app.require_subcommand(1);

  io::DvlCommand dvl;
  CLI::App* dvl_app = app.add_subcommand("dvl", "RDI PD0 ensembles with bottom track");
  dvl_app->add_option("FILE", dvl.file, "PD0 capture")->required();
  dvl_app->add_flag("--csv", dvl.csv,
                    "A row per ensemble instead of a summary; absent values are empty fields");
  dvl_app->footer("Example: fathom-sensors dvl dive.pd0 --csv > dive.csv\n");

  io::CanCommand can;
  CLI::App* can_app = app.add_subcommand("can", "NMEA 2000 messages of a CAN capture");
  can_app
      ->add_option("FILE", can.file,
                   "text of candump, canboat (plain), Yacht Devices (RAW) or Actisense (N2K ASCII), or a "
                   "mission's sensors.lcmlog")
      ->required();
  can_app->add_flag("--json", can.json,
                    "One JSON object a message instead of a summary; absent values are left out");
  can_app->footer("Example: fathom-sensors can candump.log --json > can.jsonl\n");

  io::PrediveCommand predive;
  CLI::App* predive_app =
      app.add_subcommand("predive", "Checks every device before the launch: green or red");
  predive_app->add_option("FOLDER", predive.folder, "Mission folder with mission.toml and stereo.calib")
      ->required();
  predive_app->add_option("--config", predive.config, "onboard.toml of the dive")->required();
  predive_app->add_option("--seconds", predive.seconds, "Time for which the devices are checked [s]")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  predive_app->add_flag("--json", predive.json, "One JSON object instead of the table");
  predive_app->footer(
      "Exit status 0: no row is red. Example: fathom-sensors predive dives/today --config onboard.toml\n");

  app.set_version_flag("--version", versionLine("fathom-sensors"));
  if (const auto code = parseCommandLine("fathom-sensors", app, argc, argv)) return *code;
  return runTool("fathom-sensors", [&] {
    if (dvl_app->parsed()) return io::runDvlCommand(dvl, stdout, stderr);
    if (can_app->parsed()) return io::runCanCommand(can, stdout, stderr);
    predive.colours = ::isatty(STDOUT_FILENO) == 1 && std::getenv("NO_COLOR") == nullptr;
    const auto make_link = [&](const io::MissionConfig& mission, const ConfigTable& table) {
      const std::filesystem::path key_file = table.text("key_file", "");
      std::optional<telemetry::LinkKey> key;
      std::string warning;
      if (!key_file.empty()) key = telemetry::readLinkKey(predive.config.parent_path() / key_file, warning);
      const auto modem_bytes = static_cast<std::size_t>(table.integer("modem_bytes", 0, 0, 2048));
      return makeLink(mission, key, table.boolean("padded", false) ? modem_bytes : 0);
    };
    return io::runPrediveCommand(predive, make_link, stdout);
  });
}
