#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <optional>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/topside/calibrate_command.hpp"
#include "recon/topside/check_calibration_command.hpp"
#include "recon/topside/compare/compare_command.hpp"
#include "recon/topside/output/check_tiles_command.hpp"
#include "recon/topside/output/export_model_command.hpp"
#include "recon/topside/pipeline.hpp"
#include "recon/topside/posegraph_command.hpp"
#include "recon/topside/slam_command.hpp"
#include "recon/topside/stereo_command.hpp"

int main(int argc, char** argv) {
  CLI::App app{"fathom-topside: from a recorded mission to a map"};
  app.set_version_flag("--version", FATHOM_VERSION);
  app.require_subcommand(1);
  CLI::App* run = app.add_subcommand("run", "lighting, stereo, navigation and fusion of a whole mission");
  std::filesystem::path mission, out, config_file;
  std::optional<double> voxel;
  std::optional<int> features, threads;
  run->add_option("mission", mission, "mission folder")->required();
  run->add_option("--out", out, "folder for the results (MISSION/topside)");
  run->add_option("--config", config_file, "TOML file; keys are in recon/topside/README.md");
  run->add_option("--voxel", voxel, "edge of a voxel [m] (0.033)")->check(CLI::Range(0.002, 2.0));
  run->add_option("--features", features, "corners or dense points wanted in an image (800)")
      ->check(CLI::Range(20, 5000));
  bool dense = false;
  run->add_flag("--dense", dense, "semi-global matching instead of corners");
  bool no_slam = false;
  run->add_flag("--no-slam", no_slam, "dead-reckoned poses: no visual odometry, no loop closures");
  run->add_option("--threads", threads, "threads (all cores); the result does not depend on them")
      ->check(CLI::Range(1, 256));
  CLI::App* compare = nullptr;
  const std::function<int()> run_compare = fathom::topside::addCompareCommand(app, compare);
  CLI::App* check_tiles = nullptr;
  const std::function<int()> run_check_tiles = fathom::topside::addCheckTilesCommand(app, check_tiles);
  CLI::App* export_model = nullptr;
  const std::function<int()> run_export_model = fathom::topside::addExportModelCommand(app, export_model);
  CLI::App *stereo = nullptr, *calibrate = nullptr, *check = nullptr, *posegraph = nullptr, *slam = nullptr;
  const std::function<int()> run_stereo = fathom::topside::addStereoCommand(app, stereo);
  const std::function<int()> run_calibrate = fathom::topside::addCalibrateCommand(app, calibrate);
  const std::function<int()> run_check = fathom::topside::addCheckCalibrationCommand(app, check);
  const std::function<int()> run_posegraph = fathom::topside::addPosegraphCommand(app, posegraph);
  const std::function<int()> run_slam = fathom::topside::addSlamCommand(app, slam);
  if (const auto code = fathom::parseCommandLine("fathom-topside", app, argc, argv)) return *code;
  return fathom::runTool("fathom-topside", [&]() -> int {
    using namespace fathom::topside;
    if (*compare) return run_compare();
    if (*stereo) return run_stereo();
    if (*calibrate) return run_calibrate();
    if (*check) return run_check();
    if (*posegraph) return run_posegraph();
    if (*slam) return run_slam();
    if (*check_tiles) return run_check_tiles();
    if (*export_model) return run_export_model();
    TopsideConfig config = config_file.empty() ? TopsideConfig{} : readTopsideConfig(config_file);
    if (voxel) setVoxel(config, *voxel);
    if (no_slam) config.slam = false;
    if (dense) config.dense_stereo = true;
    if (features) config.stereo.max_features = *features;
    if (threads) config.threads = *threads;
    const Summary done = runTopside(mission, out.empty() ? mission / "topside" : out, config);
    std::printf("%zu of %zu pairs in the map (%zu unreadable): %.1f m2, %zu triangles, %.1f s\n", done.used,
                done.pairs, done.unreadable, done.area, done.triangles, done.seconds);
    return fathom::kExitSuccess;
  });
}
