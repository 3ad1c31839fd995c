#include <memory>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/install_prefix.hpp"
#include "sim/commands.hpp"
#include "sim/hil/hil_compare.hpp"
#include "sim/hil/hil_run.hpp"

namespace fathom::sim {

Command addHilCommand(CLI::App& app) {
  const auto options = std::make_shared<HilOptions>();
  HilOptions& o = *options;
  // A bench's water is clear and fast unless asked otherwise, so that a run can be held to the direct replay.
  o.water.loss = o.water.duplicate = o.water.reorder = o.water.corrupt = 0;
  o.water.delay_s = 0.5;
  o.water.rate_bps = 2400;
  o.water.frame_bytes = 64;  // a fix and an acknowledgement in one
  CLI::App* command =
      app.add_subcommand("hil", "play a mission through real interfaces to fathom-onboard, in real time");
  command->footer("Example: fathom-sim hil missions/reef-quick --out run");
  command->add_option("mission", o.mission, "mission folder with pictures")->required();
  command->add_option("--out", o.out, "folder for all that comes of it")->required();
  command->add_option("--faults", o.faults, "script of faults (sim/hil/README.md)");
  command->add_option("--config", o.config, "onboard.toml without [cameras], [dvl], [can], [lcm], [modem]");
  command->add_option("--rate", o.rate, "mission seconds a second")
      ->check(CLI::Range(0.05, 20.0))
      ->capture_default_str();
  command->add_option("--from", o.from_s, "begin at this second of the mission")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--seconds", o.seconds, "of the mission; 0: to its end")->check(CLI::NonNegativeNumber);
  command->add_option("--laps", o.laps, "forward, backward, forward...")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command
      ->add_option("--lead", o.lead_s,
                   "from now to the mission's begin [s]: cameras are found, the program arms")
      ->check(CLI::Range(2.0, 600.0))
      ->capture_default_str();
  command->add_option("--onboard", o.onboard,
                      "the program under test (default: fathom-onboard beside this one)");
  command->add_option("--onboard-option", o.onboard_options, "one more option for it, repeatable")
      ->allow_extra_args(false);
  command->add_flag("--wait", o.wait, "do not start the program: say how, and play");
  command->add_flag("--force", o.force, "replace an earlier run");
  command->add_flag("--no-compare", o.no_compare, "play only; fathom-sim hil-compare can follow");
  command->add_flag("--udp-modem", o.udp_modem, "the modem on UDP instead of a pseudo-terminal");
  command->add_option("--left-ppm", o.left_ppm, "drift of the left camera's clock")
      ->check(CLI::Range(-500.0, 500.0))
      ->capture_default_str();
  command->add_option("--right-ppm", o.right_ppm, "drift of the right camera's clock")
      ->check(CLI::Range(-500.0, 500.0))
      ->capture_default_str();
  command->add_option("--loss", o.water.loss, "share of the modem's frames lost")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--delay", o.water.delay_s, "of sound, one way [s]")
      ->check(CLI::Range(0.0, 30.0))
      ->capture_default_str();
  command->add_option("--link-rate", o.water.rate_bps, "of either modem [bit/s]")
      ->check(CLI::Range(80.0, 5400.0))
      ->capture_default_str();
  return {command, [options] { return runHil(*options); }};
}

Command addHilCompareCommand(CLI::App& app) {
  const auto options = std::make_shared<HilComparison>();
  CLI::App* command =
      app.add_subcommand("hil-compare", "hold a run of hil to its replays and to what was injected");
  command->footer("Example: fathom-sim hil-compare run");
  command->add_option("run", options->run, "folder of the run")->required();
  command->add_option("mission", options->mission, "mission folder that was played")->required();
  command->add_option("--onboard", options->onboard, "fathom-onboard (default: beside this program)");
  return {command, [options] {
            if (options->onboard.empty()) options->onboard = installPrefix() / "bin/fathom-onboard";
            return compareHil(*options) ? kExitSuccess : kExitFailedWork;
          }};
}

}  // namespace fathom::sim
