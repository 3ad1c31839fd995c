#include <gtest/gtest.h>

#include <cstdlib>

#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"
#include "tests/tiles/synthetic_model.hpp"

namespace fathom::topside {
namespace {

// With the libraries that the pages are built with.
TEST(PageLibraries, KhronosValidatorThreesDracoAndItsKtxReaderTakeEveryKindOfTile) {
  const std::filesystem::path pages = FATHOM_PAGES;
  for (const char* module : {"three", "gltf-validator"})
    if (!std::filesystem::exists(pages / "node_modules" / module))
      GTEST_SKIP() << module << " is not installed";
  const fathom::test::TemporaryFolder scratch;
  synthetic::SyntheticModel model;
  std::string files;
  const auto add = [&](const std::string& name, const std::vector<std::uint8_t>& bytes) {
    fathom::test::writeBytes(scratch.path() / name, bytes);
    files += " " + (scratch.path() / name).string();
  };
  GlbConfig config;
  config.gpu_texture = "a.ktx2";
  add("jpeg.glb", writeGlb(model.tile({0, -3, 1000}), model.grid, config));
  config.picture.format = PictureFormat::kWebp;
  add("webp.glb", writeGlb(model.tile({3, 0, -1}), model.grid, config));
  config.picture.format = PictureFormat::kNone;
  add("beside.glb", writeGlb(model.tile({1, 0, 0}), model.grid, config));
  const BlockTexture texture = compressBlocks(model.tile({0, 0, 0}).atlas);
  add("plain.ktx2", writeKtx2(texture));
  add("packed.ktx2", writeKtx2(texture, Supercompression::kZstd));
  model.texels = 0;
  add("colours.glb", writeGlb(model.tile({1, 0, 0}), model.grid, {}));
  const std::string command =
      "cd '" + pages.string() + "' && node " FATHOM_SOURCE_DIR "/tests/tiles/page_libraries.mjs" + files;
  EXPECT_EQ(std::system(command.c_str()), 0);
}

}  // namespace
}  // namespace fathom::topside
