// fathom-sensors: checks hardware before a dive and decodes captures.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "firmware_if/dvl/dvl_command.hpp"
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

  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "fathom-sensors: %s (see --help)\n", error.what());
    return kExitBadInput;
  }
  return runTool("fathom-sensors", [&] { return io::runDvlCommand(dvl, stdout, stderr); });
}
