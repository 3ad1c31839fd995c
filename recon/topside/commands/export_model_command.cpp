#include "recon/topside/commands/export_model_command.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/tiles/model_file.hpp"

namespace fathom::topside {
namespace {

struct Options {
  std::filesystem::path folder, ply, obj;
  int level = 0;
};

int run(const Options& options) {
  if (options.ply.empty() && options.obj.empty())
    throw InputError("export-model", "", "writes nothing; name a file with --ply or --obj");
  const bool above = std::filesystem::is_directory(options.folder / "tiles");
  const std::filesystem::path tiles = above ? options.folder / "tiles" : options.folder;
  const std::vector<TileId> ids = tilesOfLevel(tiles, options.level);
  if (ids.empty())
    throw InputError(options.folder.string(), "level " + std::to_string(options.level),
                     "has no tiles; name a folder of tiles and a level that it has");
  const auto tell = [](const std::filesystem::path& path, const ModelCounts& counts) {
    std::printf("%s: %llu tiles, %llu vertices, %llu triangles\n", path.c_str(),
                static_cast<unsigned long long>(counts.tiles),
                static_cast<unsigned long long>(counts.vertices),
                static_cast<unsigned long long>(counts.triangles));
  };
  if (!options.ply.empty()) tell(options.ply, writeModelPly(options.ply, ids, glbSource(tiles)));
  if (!options.obj.empty()) tell(options.obj, writeModelObj(options.obj, ids, glbSource(tiles)));
  return kExitSuccess;
}

}  // namespace

std::function<int()> addExportModelCommand(CLI::App& app, CLI::App*& command) {
  const auto options = std::make_shared<Options>();
  command = app.add_subcommand("export-model", "one level of a model's tiles as PLY or OBJ for other tools");
  command->footer(
      "Example: fathom-topside export-model missions/reef-grid/topside --level 0 --obj model.obj");
  command->add_option("folder", options->folder, "the tiles' folder, or the one above it")->required();
  command->add_option("--level", options->level, "0 is the finest (0)")->check(CLI::Range(0, 12));
  command->add_option("--ply", options->ply, "file to write");
  command->add_option("--obj", options->obj, "file to write; beside it NAME.mtl and NAME_textures/");
  return [options] { return run(*options); };
}

}  // namespace fathom::topside
