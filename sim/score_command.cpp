#include <cstdio>
#include <memory>

#include "realtime/kernel/input_error.hpp"
#include "sim/commands.hpp"
#include "sim/score/colour_detail.hpp"
#include "sim/score/score.hpp"

namespace fathom::sim {

Command addScoreCommand(CLI::App& app) {
  struct State {
    std::filesystem::path mission;
    std::vector<std::filesystem::path> surfaces;
    std::filesystem::path maps;
    bool json = false;
  };
  const auto state = std::make_shared<State>();
  CLI::App* command = app.add_subcommand("score", "compare what was estimated with the truth");
  command->footer("Example: fathom-sim score missions/reef-grid");
  command->add_option("mission", state->mission, "mission folder")->required();
  command->add_option("--surface", state->surfaces,
                      "also these PLY meshes in nav, such as levels of the model");
  command->add_option("--colour-maps", state->maps,
                      "folder for pictures: truth, product and error of every product's colours");
  command->add_flag("--json", state->json, "one JSON object instead of a table");
  return {command, [state] {
            const ScoreReport report = scoreMission(state->mission, state->surfaces);
            for (const std::string& note : report.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
            if (!state->maps.empty()) {
              std::filesystem::create_directories(state->maps);
              for (const auto& [name, score] : report.colours)
                writeColourMap(state->maps / (std::filesystem::path(name).stem().string() + ".png"), score);
            }
            std::printf("%s\n", state->json ? scoreJson(report).c_str() : scoreTable(report).c_str());
            return kExitSuccess;
          }};
}

}  // namespace fathom::sim
