#include <array>
#include <cstdio>
#include <memory>
#include <string_view>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "recon/compare/compare.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/report/compare_report.hpp"

namespace fathom::topside {
namespace {

constexpr std::array<std::string_view, 6> kCompareFiles = {
    "difference.tif", "difference.png", "survey.png", "reference.png", "compare.json", "compare.html"};

std::filesystem::path defaultFolder(const std::filesystem::path& survey) {
  const std::filesystem::path whole = std::filesystem::absolute(survey).lexically_normal();
  return (whole.has_filename() ? whole.parent_path() : whole.parent_path().parent_path()) / "compare";
}

}  // namespace

compare::PlaneFrame frameBeside(const std::filesystem::path& mesh) {
  const std::filesystem::path folder = std::filesystem::absolute(mesh).parent_path();
  std::error_code error;
  if (std::filesystem::exists(folder / "stereo_pose_est.data", error))
    return compare::localFrame(io::readStereoPoses(folder / "stereo_pose_est.data").origin);
  for (const auto& place : {folder, folder.parent_path()})
    if (std::filesystem::exists(place / "mission.toml", error))
      return compare::localFrame(io::readMissionConfig(place).origin);
  return {};
}

void addCompareCommand(CommandLine& app) {
  struct State {
    compare::CompareOptions options;
    bool json = false, no_shift = false;
  };
  const auto state = std::make_shared<State>();
  compare::CompareOptions& o = state->options;
  o.reference_up = "auto";
  o.beside = frameBeside;
  CommandLine& command = app.command(
      "compare", "heights against gridded multibeam or another dive",
      "Example: fathom-topside compare missions/reef-grid/topside --reference multibeam.tif --out beside",
      [state]() -> int {
        compare::CompareOptions& options = state->options;
        options.registration.horizontal = !state->no_shift;
        if (options.out.empty()) options.out = defaultFolder(options.survey);
        OutputFolder folder(options.out, kCompareFiles);
        const compare::Comparison comparison = compare::compareSurfaces(options);
        writeComparison(comparison, folder.path());
        folder.commit();
        std::printf("%s", (state->json ? comparisonJson(comparison) : comparisonText(comparison)).c_str());
        return kExitSuccess;
      });
  command
      .add_option("survey", o.survey,
                  "folder of fathom-topside's results, its elevation GeoTIFF or its mesh.ply")
      ->required();
  command
      .add_option("--reference", o.reference,
                  "XYZ text, GeoTIFF or another raster, PLY mesh, or folder of another dive")
      ->required();
  command.add_option("--out", o.out, "folder for the results (compare/ beside the survey)");
  command.add_option("--reference-crs", o.reference_crs,
                     "EPSG:<code>, WKT or PROJ string, where the reference does not say it");
  command.shown("--reference-z", o.reference_up, "the reference's third number: up, down or auto")
      ->check(CLI::IsMember({"auto", "up", "down"}));
  command.add_option("--cell", o.cell, "edge of a compared cell [m] (the coarser surface's own)")
      ->check(CLI::Range(0.001, 1000.0));
  command.shown("--max-shift", o.registration.max_shift, "largest horizontal offset looked for [m]", 0.01,
                1000.0);
  command.add_flag("--tilt", o.registration.tilt, "also a slope between the two");
  command.add_flag("--no-shift", state->no_shift, "no horizontal offset: heights alone");
  command.add_flag("--json", state->json, "print the JSON instead of a few lines");
}

}  // namespace fathom::topside
