#include <filesystem>

#include "realtime/base/command_line.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "tests/world/tiles.hpp"

namespace {

void writeIn(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  std::filesystem::create_directories(path.parent_path());
  fathom::writeFile(path, bytes);
}

}  // namespace

// Writes a synthetic model as a tileset, for whatever opens tilesets: the page, validators, other viewers.
int main(int argc, char** argv) {
  std::filesystem::path folder;
  int levels = 3;
  fathom::test::SyntheticModel model;
  bool webp = false, ktx2 = false;
  fathom::CommandLine app("example_tiles: a synthetic seafloor as 3D tiles", "", [&] {
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
  app.add_option("folder", folder, "where tileset.json and the tiles are written")->required();
  app.shown("--levels", levels, "levels of tiles; the finest has 16^(levels - 1)", 1, 5);
  app.shown("--texels", model.texels, "along an atlas's edge; 0: colours at vertices", 0, 4096);
  app.add_flag("--webp", webp, "WebP in place of JPEG");
  app.add_flag("--ktx2", ktx2, "compressed textures for the GPU beside the tiles");
  return app.run("example_tiles", argc, argv);
}
