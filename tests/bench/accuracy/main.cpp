// The topside's model against the truth of a simulated mission: surface and texture, level by level; with
// --oracle, where the surface's error comes from.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "tests/bench/accuracy/accuracy_page.hpp"

namespace {

void write(const std::filesystem::path& path, const std::string& text) {
  fathom::AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("The topside's model against the truth of a simulated mission, surface and texture by level");
  std::filesystem::path mission, results, out, config_file;
  bool oracle = false, no_model = false;
  int features = 0;
  app.add_option("mission", mission, "simulated mission")->required();
  app.add_option("--results", results, "folder of fathom-topside (MISSION/topside)");
  app.add_option("--out", out, "folder that gets accuracy.html, accuracy.json and pictures");
  app.add_flag("--oracle", oracle, "also fuse with points and poses replaced by the truth");
  app.add_flag("--no-model", no_model, "leave the tiles out");
  app.add_option("--config", config_file, "of --oracle: TOML file of fathom-topside run");
  app.add_option("--features", features, "of --oracle: corners wanted in an image")
      ->check(CLI::Range(20, 5000));
  if (const auto code = fathom::parseCommandLine("report_accuracy", app, argc, argv)) return *code;
  return fathom::runTool("report_accuracy", [&]() -> int {
    using namespace fathom::accuracy;
    if (results.empty()) results = mission / "topside";
    if (!out.empty()) std::filesystem::create_directories(out);
    AccuracyReport report;
    report.mission = mission.string();
    if (!no_model) report.model = measureModel(mission, results, out);
    if (oracle) {
      auto config = config_file.empty() ? fathom::topside::TopsideConfig{}
                                        : fathom::topside::readTopsideConfig(config_file);
      if (features > 0) config.stereo.max_features = features;
      report.variants = fuseVariants(mission, results / "stereo_pose_est.data", config);
    }
    std::printf("%s", toText(report).c_str());
    if (!out.empty()) {
      write(out / "accuracy.json", toJson(report));
      write(out / "accuracy.html", toHtml(report));
    }
    return fathom::kExitSuccess;
  });
}
