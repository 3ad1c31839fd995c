
#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/check/tileset_reader.hpp"
#include "recon/products/tiles/glb.hpp"
#include "tests/fuzz/scratch_file.hpp"
#include "tests/world/tiles.hpp"

using namespace fathom;
using Bytes = std::vector<std::uint8_t>;

namespace {

// A good file with some of its bytes changed: four of `edits` name a place and what stands there.
Bytes edited(Bytes file, std::span<const std::uint8_t> edits) {
  for (; edits.size() >= 4; edits = edits.subspan(4))
    file[(edits[0] | edits[1] << 8 | edits[2] << 16) % file.size()] = edits[3];
  return file;
}

void readTile(const Bytes& bytes) {
  fuzz::readsOrRefuses([&] {
    const topside::ReadTile read = topside::readGlb(bytes, "tile.glb");
    const Mesh& mesh = read.tile.surface.mesh;
    for (const auto& triangle : mesh.triangles)
      for (const std::uint32_t k : triangle)
        if (k >= mesh.vertices.size()) __builtin_trap();
    if (read.tile.surface.shared.size() != mesh.vertices.size()) __builtin_trap();
  });
}

}  // namespace

// Any bytes, and good files with any bytes in them, as a tile, as a texture of each kind and as a tileset;
// the first byte says which.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::SyntheticModel model{.texels = 16};
  static const Bytes tile = topside::writeGlb(model.tile({0, 0, 0}), model.grid, {});
  static const topside::BlockTexture texture = topside::compressBlocks(model.tile({0, 0, 0}).atlas);
  static const Bytes ktx = topside::writeKtx2(texture, topside::Supercompression::kZstd);
  static const Bytes dds = topside::writeDds(texture);
  static const fuzz::ScratchFile scratch("tileset.json");
  if (size == 0) return 0;
  const std::span<const std::uint8_t> rest(data + 1, size - 1);
  const Bytes raw(rest.begin(), rest.end());
  switch (data[0] % 7) {
    case 0:
      readTile(raw);
      break;
    case 1:
      readTile(edited(tile, rest));
      break;
    case 2:
    case 3:
      fuzz::readsOrRefuses([&] {
        static_cast<void>(topside::readKtx2(data[0] % 7 == 2 ? raw : edited(ktx, rest), "t.ktx2"));
      });
      break;
    case 4:
    case 5:
      fuzz::readsOrRefuses(
          [&] { static_cast<void>(topside::readDds(data[0] % 7 == 4 ? raw : edited(dds, rest), "t.dds")); });
      break;
    default:
      scratch.write(rest.data(), rest.size());
      fuzz::readsOrRefuses([&] { static_cast<void>(topside::readTilesets(scratch.folder())); });
  }
  return 0;
}
