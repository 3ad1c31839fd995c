#include <cstdio>
#include <memory>

#include "realtime/kernel/input_error.hpp"
#include "sim/commands.hpp"
#include "sim/mission/control_maker.hpp"

namespace fathom::sim {

Command addControlCommand(CLI::App& app) {
  struct State {
    std::filesystem::path mission;
    ControlMakerOptions options;
  };
  const auto state = std::make_shared<State>();
  CLI::App* command =
      app.add_subcommand("control", "surveys and marks points on a simulated dive's seafloor, with errors");
  command->footer("Example: fathom-sim control missions/reef-grid --points 5 --checks 5");
  command->add_option("mission", state->mission, "mission folder with its truth")->required();
  ControlMakerOptions& o = state->options;
  command->add_option("--out", o.out, "folder (MISSION/control)");
  command->add_option("--points", o.points, "control points")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_option("--checks", o.checks, "check points")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_option("--bars", o.bars, "scale bars")->check(CLI::Range(0, 1000))->capture_default_str();
  command->add_option("--sigma", o.sigma, "of a survey, each axis [m]")
      ->check(CLI::Range(1e-4, 10.0))
      ->capture_default_str();
  command->add_option("--bar-length", o.bar_length, "about [m]")
      ->check(CLI::Range(0.05, 100.0))
      ->capture_default_str();
  command->add_option("--bar-sigma", o.bar_sigma, "of its length [m]")
      ->check(CLI::Range(1e-5, 1.0))
      ->capture_default_str();
  command->add_option("--pixel-sigma", o.pixel_sigma, "of a mark [px]")
      ->check(CLI::Range(0.01, 50.0))
      ->capture_default_str();
  command->add_option("--marks", o.marks, "of a point, at most")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--seed", o.seed, "of all draws")->capture_default_str();
  return {command, [state] {
            const ControlMakerReport made = makeControl(state->mission, state->options);
            std::printf("%s: %d points, %d marks, %d scale bars\n", made.folder.string().c_str(), made.points,
                        made.marks, made.bars);
            return kExitSuccess;
          }};
}

}  // namespace fathom::sim
