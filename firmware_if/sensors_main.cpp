// fathom-sensors: checks hardware before a dive and decodes captures.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "firmware_if/can/can_command.hpp"
#include "firmware_if/dvl/dvl_command.hpp"
#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"

int main(int argc, char** argv) {
  using namespace fathom;

  CLI::App app{"Decodes captures of a vehicle's sensors."};
  app.footer("Example: fathom-sensors dvl dive.pd0 --csv > dive.csv\n");
  app.require_subcommand(1);

  io::DvlCommand dvl;
  CLI::App* dvl_app = app.add_subcommand("dvl", "RDI PD0 ensembles with bottom track");
  dvl_app->add_option("FILE", dvl.file, "PD0 capture")->required();
  dvl_app->add_flag("--csv", dvl.csv,
                    "A row per ensemble instead of a summary; absent values are empty fields");
  dvl_app->footer("Example: fathom-sensors dvl dive.pd0 --csv > dive.csv\n");

  io::CanCommand can;
  CLI::App* can_app = app.add_subcommand("can", "NMEA 2000 messages of a CAN capture in candump's text form");
  can_app->add_option("FILE", can.file, "candump capture")->required();
  can_app->add_flag("--json", can.json,
                    "One JSON object a message instead of a summary; absent values are left out");
  can_app->footer("Example: fathom-sensors can candump.log --json > can.jsonl\n");

  if (const auto code = parseCommandLine("fathom-sensors", app, argc, argv)) return *code;
  return runTool("fathom-sensors", [&] {
    if (dvl_app->parsed()) return io::runDvlCommand(dvl, stdout, stderr);
    return io::runCanCommand(can, stdout, stderr);
  });
}
