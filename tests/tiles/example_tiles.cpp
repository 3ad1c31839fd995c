#include <CLI/CLI.hpp>
#include <filesystem>

#include "realtime/base/command_line.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace {

void writeIn(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  std::filesystem::create_directories(path.parent_path());
  fathom::writeFile(path, bytes);
}

}  // namespace

// Writes a synthetic model as a tileset, for whatever opens tilesets: the page, validators, other viewers.
int main(int argc, char** argv) {
  CLI::App app{"example_tiles: a synthetic seafloor as 3D tiles"};
  std::filesystem::path folder;
  int levels = 3;
  fathom::topside::synthetic::SyntheticModel model;
  bool webp = false, ktx2 = false;
  app.add_option("folder", folder, "where tileset.json and the tiles are written")->required();
  app.add_option("--levels", levels, "levels of tiles; the finest has 16^(levels - 1)")
      ->check(CLI::Range(1, 5));
  app.add_option("--texels", model.texels, "along an atlas's edge; 0: colours at vertices")
      ->check(CLI::Range(0, 4096));
  app.add_flag("--webp", webp, "WebP in place of JPEG");
  app.add_flag("--ktx2", ktx2, "compressed textures for the GPU beside the tiles");
  if (const auto code = fathom::parseCommandLine("example_tiles", app, argc, argv)) return *code;
  return fathom::runTool("example_tiles", [&]() -> int {
    using namespace fathom::topside;
    GlbConfig config;
    if (webp) config.picture.format = PictureFormat::kWebp;
    std::vector<TileEntry> entries;
    for (const fathom::TileId& id : model.pyramid(levels)) {
      const fathom::TexturedTile tile = model.tile(id);
      entries.push_back(entryOf(tile));
      if (ktx2 && !tile.atlas.empty()) {
        config.gpu_texture = std::filesystem::path(tilePath(id, ".ktx2")).filename();
        writeIn(folder / tilePath(id, ".ktx2"), writeKtx2(compressBlocks(tile.atlas)));
      }
      writeIn(folder / tilePath(id), writeGlb(tile, model.grid, config));
    }
    writeTilesets(folder, entries,
                  fathom::Geodetic{fathom::degreesToRadians(-28.8), fathom::degreesToRadians(113.9)});
    std::printf("%zu tiles\n", entries.size());
    return fathom::kExitSuccess;
  });
}
