#include <algorithm>
#include <cstdio>
#include <iterator>
#include <memory>
#include <string>

#include "realtime/base/progress.hpp"
#include "sim/campaign/campaign.hpp"
#include "sim/commands.hpp"
#include "sim/picture/picture.hpp"
#include "sim/score/colour_score.hpp"
#include "sim/score/score.hpp"

namespace fathom::sim {

void addScoreCommand(CommandLine& app) {
  struct State {
    std::filesystem::path mission;
    std::vector<std::filesystem::path> surfaces;
    std::filesystem::path maps;
    bool json = false;
  };
  const auto state = std::make_shared<State>();
  CommandLine& command = app.command(
      "score", "compare estimates with the truth", "Example: fathom-sim score missions/reef-grid", [state] {
        const ScoreReport report = scoreMission(state->mission, state->surfaces);
        for (const std::string& note : report.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
        if (!state->maps.empty()) {
          std::filesystem::create_directories(state->maps);
          for (const auto& [name, score] : report.colours)
            writeColourMap(state->maps / (std::filesystem::path(name).stem().string() + ".png"), score);
        }
        std::printf("%s\n", state->json ? scoreJson(report).c_str() : scoreTable(report).c_str());
        return kExitSuccess;
      });
  command.add_option("mission", state->mission, "mission folder")->required();
  command.add_option("--surface", state->surfaces,
                     "also these PLY meshes in nav, such as levels of the model");
  command.add_option("--colour-maps", state->maps,
                     "folder for pictures: truth, product and error of every product's colours");
  command.add_flag("--json", state->json, "one JSON object instead of a table");
}

void addCampaignCommand(CommandLine& app) {
  const auto options = std::make_shared<CampaignOptions>();
  const auto series = std::make_shared<std::string>(kDiveSeries[0]);
  CommandLine& command = app.command(
      "campaign", "simulate many perturbed dives, and report which fail",
      "Example: fathom-sim campaign --out missions/campaign --dives 186", [options, series] {
        if (options->programs.empty())
          options->programs = std::filesystem::read_symlink("/proc/self/exe").parent_path();
        const auto named = std::find(std::begin(kDiveSeries), std::end(kDiveSeries), *series);
        options->series = static_cast<DiveSeries>(named - std::begin(kDiveSeries));
        rt::ProgressBar bar;
        options->progress = [&bar](std::size_t done, std::size_t total) { bar.show(done, total, "dives"); };
        const auto dives = runCampaign(*options);
        std::printf("%zu dives: %s\n", dives.size(), (options->out / "campaign.html").c_str());
        return kExitSuccess;
      });
  command
      .add_option("--out", options->out,
                  "folder for results.jsonl and campaign.html; dives that it holds are not repeated")
      ->required();
  command
      .shown(
          "--series", *series,
          "single: one perturbation a dive, by levels; tune, judge: all together, two halves that share no "
          "random number")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kDiveSeries), std::end(kDiveSeries))));
  command.shown("--dives", options->dives, "total number", 1, 1'000'000);
  command.add_option("--only", options->only, "repeat this dive alone and keep its mission");
  command.shown("--seed", options->seed, "of all dives", 0, 1'000'000);
  command.shown("--jobs", options->jobs, "dives in parallel, one core each", 1, 256);
  command.add_option("--programs", options->programs,
                     "folder of fathom-onboard and fathom-topside (default: this program's)");
}

namespace {

// Checked before the mesh is drawn.
void requireWritable(const std::filesystem::path& png) {
  std::error_code error;
  if (std::filesystem::is_directory(png, error))
    throw InputError("--out", png.string(), "is a folder; name a PNG file");
  if (png.has_parent_path() && !std::filesystem::is_directory(png.parent_path(), error))
    throw InputError("--out", png.string(),
                     "is in no existing folder; make " + png.parent_path().string() + " first");
}

}  // namespace

void addPictureCommand(CommandLine& app) {
  struct State {
    std::filesystem::path mesh, png;
    std::string view = "oblique", size = "1280x960";
  };
  const auto state = std::make_shared<State>();
  CommandLine& command = app.command(
      "picture", "draw a PLY mesh as a PNG",
      "Example: fathom-sim picture missions/reef-grid/topside/mesh.ply --out mesh.png --view oblique",
      [state] {
        PictureOptions options;
        options.view = state->view == "top" ? PictureOptions::View::kTop : PictureOptions::View::kOblique;
        int used = 0;
        if (std::sscanf(state->size.c_str(), "%5dx%5d%n", &options.width, &options.height, &used) != 2 ||
            static_cast<std::size_t>(used) != state->size.size())
          throw InputError("--size", state->size, "is not WxH, such as 1280x960");
        requireWritable(state->png);
        drawPicture(state->mesh, state->png, options);
        return static_cast<int>(kExitSuccess);
      });
  command.add_option("mesh", state->mesh, "PLY mesh in nav: north, east, down [m]")->required();
  command.add_option("--out", state->png, "PNG to write")->required();
  command.shown("--view", state->view, "top or oblique")->check(CLI::IsMember({"top", "oblique"}));
  command.shown("--size", state->size, "WxH [px]");
}

}  // namespace fathom::sim
