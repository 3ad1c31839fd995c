#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "recon/products/tiles/check/tile_check.hpp"
#include "recon/topside/commands/commands.hpp"

namespace fathom::topside {
namespace {

struct CheckTilesOptions {
  std::filesystem::path folder;
  bool json = false;
};

void print(const TileCheck& check) {
  for (const std::string& fault : check.faults) std::printf("%s\n", fault.c_str());
  std::printf("%llu tiles in %llu levels (%llu tilesets), %llu triangles, %.1f million texels, %.1f MB\n",
              static_cast<unsigned long long>(check.tiles), static_cast<unsigned long long>(check.levels),
              static_cast<unsigned long long>(check.tileset_files),
              static_cast<unsigned long long>(check.triangles), 1e-6 * static_cast<double>(check.texels),
              1e-6 * static_cast<double>(check.bytes));
  std::printf(
      "cracks: %llu between tiles (%llu edges equal), %llu between levels (%llu edges equal); %zu faults\n",
      static_cast<unsigned long long>(check.cracks_between_tiles),
      static_cast<unsigned long long>(check.edges_between_tiles),
      static_cast<unsigned long long>(check.cracks_between_levels),
      static_cast<unsigned long long>(check.edges_between_levels), check.faults.size());
}

void printJson(const TileCheck& check) {
  const nlohmann::ordered_json json{{"good", check.faults.empty()},
                                    {"tiles", check.tiles},
                                    {"levels", check.levels},
                                    {"tilesets", check.tileset_files},
                                    {"triangles", check.triangles},
                                    {"texels", check.texels},
                                    {"bytes", check.bytes},
                                    {"edges_between_tiles", check.edges_between_tiles},
                                    {"cracks_between_tiles", check.cracks_between_tiles},
                                    {"edges_between_levels", check.edges_between_levels},
                                    {"cracks_between_levels", check.cracks_between_levels},
                                    {"open_edges", check.open_edges},
                                    {"faults", check.faults}};
  std::printf("%s\n", json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
}

}  // namespace

void addCheckTilesCommand(CommandLine& app) {
  const auto options = std::make_shared<CheckTilesOptions>();
  CommandLine& command =
      app.command("check-tiles", "whether a model's tiles are whole and join without cracks",
                  "Example: fathom-topside check-tiles missions/reef-grid/topside", [options] {
                    const TileCheck check = checkTiles(options->folder);
                    if (options->json)
                      printJson(check);
                    else
                      print(check);
                    return check.faults.empty() ? kExitSuccess : kExitFailedWork;
                  });
  command.add_option("folder", options->folder, "with tileset.json, or with tiles/tileset.json")->required();
  command.add_flag("--json", options->json, "everything as JSON");
}

}  // namespace fathom::topside
