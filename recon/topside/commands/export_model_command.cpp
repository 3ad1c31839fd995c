#include <cstdio>
#include <memory>

#include "realtime/base/input_error.hpp"
#include "recon/products/exports/model_glb.hpp"
#include "recon/products/exports/orthomosaic.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/exports/sparse_model.hpp"
#include "recon/products/exports/survey_geopackage.hpp"
#include "recon/products/tiles/model_file.hpp"
#include "recon/topside/assemble/assemble.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/config/thread_limit.hpp"
#include "recon/topside/work/repair.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

struct ExportModelOptions {
  fs::path folder, ply, obj, glb, las, gpkg, ortho, qgis, colmap, nerfstudio;
  std::string crs;
  double contours = 0, cell = 0;
  int level = 0;
  bool text = false, lossless = false;
  RunSettings run;

  [[nodiscard]] bool ofTiles() const { return !ply.empty() || !obj.empty() || !glb.empty() || !las.empty(); }
  [[nodiscard]] bool ofMaps() const { return !gpkg.empty() || !ortho.empty() || !qgis.empty(); }
  [[nodiscard]] bool ofCameras() const { return !colmap.empty() || !nerfstudio.empty(); }
};

// The folder of tiles, of a mission's folder, its results' or its own.
fs::path tilesOf(const fs::path& folder) {
  for (const fs::path& above : {folder, folder / "topside"})
    if (fs::is_directory(above / "tiles")) return above / "tiles";
  return folder;
}

// The folder of results, of the same.
fs::path resultsOf(const fs::path& folder) {
  for (const fs::path& place : {folder, folder / "topside", fs::weakly_canonical(folder).parent_path()})
    if (fs::exists(place / "scene.json")) return place;
  return folder;
}

// The mission's folder, to which its results' leads.
fs::path missionOf(const fs::path& folder) {
  if (!fs::exists(folder / "scene.json")) return folder;
  const nlohmann::json scene = readResultJson(folder / "scene.json");
  const auto mission = scene.find("mission");
  return mission != scene.end() && mission->is_string()
             ? fs::weakly_canonical(folder / mission->get<std::string>())
             : fs::weakly_canonical(folder).parent_path();
}

// As it was asked for, or the zone of UTM of the dive's origin; empty for a dive without a position.
std::string crsOf(const ExportModelOptions& options) {
  (void)frameNamed(options.crs);
  const auto origin = originOf(resultsOf(options.folder));
  if (origin) return options.crs.empty() ? utmOf(*origin) : options.crs;
  if (!options.crs.empty())
    throw InputError("--crs", options.crs,
                     "needs to know where the dive was, and nobody says so; give a run --nav with positions");
  return "";
}

constexpr const char* kNowhere = "metres of the dive's own, in no coordinate reference system";

void exportTiles(const ExportModelOptions& options) {
  const fs::path tiles = tilesOf(options.folder);
  const std::vector<TileId> ids = tilesOfLevel(tiles, options.level);
  if (ids.empty())
    throw InputError(options.folder.string(), "level " + std::to_string(options.level),
                     "has no tiles; name a folder of tiles and a level that it has");
  const auto tell = [](const fs::path& path, const ModelCounts& counts) {
    std::printf("%s: %llu tiles, %llu vertices, %llu triangles\n", path.c_str(),
                static_cast<unsigned long long>(counts.tiles),
                static_cast<unsigned long long>(counts.vertices),
                static_cast<unsigned long long>(counts.triangles));
  };
  if (!options.ply.empty()) tell(options.ply, writeModelPly(options.ply, ids, glbSource(tiles)));
  if (!options.obj.empty()) tell(options.obj, writeModelObj(options.obj, ids, glbSource(tiles)));
  if (!options.glb.empty()) tell(options.glb, writeModelGlb(options.glb, tiles, ids));
  if (!options.las.empty())
    tell(options.las, writeModelLas(options.las, ids, glbSource(tiles), frameOf(resultsOf(options.folder)),
                                    crsOf(options)));
}

void exportMaps(const ExportModelOptions& options) {
  const fs::path results = resultsOf(options.folder);
  const std::string crs = crsOf(options);
  if (!options.gpkg.empty()) {
    const GeopackageCounts counts = writeSurveyGeopackage(options.gpkg, results, crs, options.contours);
    std::printf("%s: %zu footprints, %zu contours, the track\n", options.gpkg.c_str(), counts.footprints,
                counts.contours);
  }
  if (!options.qgis.empty()) {
    writeQgisProject(options.qgis, results, crs, options.contours);
    std::printf("%s: all layers, footprints, contours, the track\n", (options.qgis / "survey.qgs").c_str());
  }
  if (!options.ortho.empty()) {
    writeOrthomosaic(options.ortho, results, {crs, options.cell, options.lossless});
    std::printf("%s: %s\n", options.ortho.c_str(), crs.empty() ? kNowhere : crs.c_str());
  }
}

void exportCameras(ExportModelOptions& options) {
  const TopsideConfig config = configOf(options.run);
  const ThreadLimit limit(config);
  RunPlaces& places = options.run.places;
  places.mission = missionOf(options.folder);
  if (places.work.empty()) places.work = places.mission / "topside.work";
  MissionInput input = openMission(places.mission, places.input);
  if (!fs::is_directory(places.work))
    throw InputError(places.work.string(), "",
                     "is not there, and cameras and points are taken from it; run 'fathom-topside run " +
                         places.mission.string() + "', or name the run's --work");
  const fs::path images = input.paths.images();
  const SparseModel model = withRepair([&] {
    StageStore store(places.work, StageStore::Access::kShared);
    RunProgress progress(1.0);
    Dive dive(input, config, store, progress, {Stage::kLevel, {}});  // makes none of what it needs
    return sparseModelOf(dive);
  });
  const auto tell = [&](const fs::path& path) {
    std::printf("%s: %zu images, %zu points, %zu pixels, %.3f px from them at the mean\n", path.c_str(),
                2 * model.views.size(), model.points.size(), 2 * model.members.size(), model.meanError());
  };
  if (model.points.empty())
    std::fprintf(stderr, "the run localised nothing, so that it kept no features: poses without points\n");
  if (!options.colmap.empty()) {
    writeColmapModel(options.colmap, model, options.text ? ColmapFormat::kText : ColmapFormat::kBinary);
    tell(options.colmap);
  }
  if (!options.nerfstudio.empty()) {
    writeNerfstudioScene(options.nerfstudio, model, images);
    tell(options.nerfstudio);
  }
}

int exportModel(ExportModelOptions& options) {
  if (options.contours > 0 && options.gpkg.empty() && options.qgis.empty())
    throw InputError("--contours", "", "are part of a GeoPackage; give --gpkg or --qgis");
  if (!options.ofTiles() && !options.ofMaps() && !options.ofCameras())
    throw InputError("export-model", "", "writes nothing; name what to write: --obj, --gpkg, --colmap ...");
  if (options.ofTiles()) exportTiles(options);
  if (options.ofMaps()) exportMaps(options);
  if ((!options.las.empty() || options.ofMaps()) && crsOf(options).empty())
    std::fprintf(stderr, "nobody says where on the Earth this dive was: %s\n", kNowhere);
  if (options.ofCameras()) exportCameras(options);
  return kExitSuccess;
}

}  // namespace

void addExportModelCommand(CommandLine& app) {
  const auto o = std::make_shared<ExportModelOptions>();
  CommandLine& command = app.command(
      "export-model", "a finished run's model, maps and cameras for other tools",
      "Example: fathom-topside export-model missions/reef-grid --glb model.glb\n"
      "Example: fathom-topside export-model missions/reef-grid --ortho reef.tif --crs EPSG:32755\n"
      "Example: fathom-topside export-model missions/reef-grid --qgis reef-gis\n"
      "Example: fathom-topside export-model missions/reef-grid --colmap reef/sparse/0\n"
      "Surface and cameras: x east, y north, z up [m], of the dive's origin (GLB: x east, y up, z south).",
      [o] { return exportModel(*o); });
  command.add_option("folder", o->folder, "the mission's folder; or its results', or their tiles'")
      ->required();
  command.add_option("--crs", o->crs, "coordinates of LAS and maps, as EPSG:32755 (the dive's zone of UTM)");

  CLI::App& tiles = *command.add_option_group("Surface", "one level of the tiles");
  tiles.add_option("--level", o->level, "0 is the finest (0)")->check(CLI::Range(0, 12));
  tiles.add_option("--ply", o->ply, "file to write");
  tiles.add_option("--obj", o->obj, "file to write; beside it NAME.mtl and NAME_textures/");
  tiles.add_option("--glb", o->glb, "file to write, with the textures inside");
  tiles.add_option("--las", o->las, "file of points to write, LAS 1.4");

  CLI::App& maps = *command.add_option_group("Maps", "for geographic information systems");
  maps.add_option("--qgis", o->qgis, "folder for a project of QGIS: all layers, and a GeoPackage beside it");
  maps.add_option("--gpkg", o->gpkg, "GeoPackage of footprints, track and contours");
  maps.add_option("--contours", o->contours, "between contours [m] (at most twenty of them)")
      ->check(CLI::Range(0.001, 1000.0));
  CLI::Option* ortho =
      maps.add_option("--ortho", o->ortho, "orthomosaic as fine as the images, cloud-optimised GeoTIFF");
  maps.add_option("--cell", o->cell, "of the orthomosaic, in units of --crs (a texel of the finest tiles)")
      ->check(CLI::Range(1e-9, 1e4))
      ->needs(ortho);
  maps.add_flag("--lossless", o->lossless, "deflate instead of JPEG")->needs(ortho);

  CLI::App& cameras =
      *command.add_option_group("Cameras", "where every image was taken, and points that images share");
  CLI::Option* colmap =
      cameras.add_option("--colmap", o->colmap, "folder for COLMAP's cameras, images and points3D");
  cameras.add_flag("--text", o->text, "COLMAP's text form instead of the binary one")->needs(colmap);
  cameras.add_option("--nerfstudio", o->nerfstudio, "folder for transforms.json and points.ply");
  addPoseSettings(*command.add_option_group("Settings of the run", "as they were given to it, for cameras"),
                  o->run);
}

}  // namespace fathom::topside
