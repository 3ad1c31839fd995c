#include <benchmark/benchmark.h>
#include <squish.h>

#include <cstdlib>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "recon/products/tiles/block_texture.hpp"
#include "recon/products/tiles/glb.hpp"
#include "recon/products/tiles/picture_codec.hpp"
#include "tests/world/tiles.hpp"

// Cost of writing a tile: CPU time a megatexel, bits a texel and PSNR of every format, on a real picture of
// the seafloor (or on another, such as an atlas: FATHOM_BENCH_PICTURE=FILE); BC1 beside libsquish on the
// same texels.
namespace fathom::topside {
namespace {

const RgbImage& seafloor() {
  static const RgbImage image = [] {
    const char* named = std::getenv("FATHOM_BENCH_PICTURE");
    const cv::Mat read = cv::imread(
        named != nullptr ? named : FATHOM_DATA_DIR "/acfr/PR_20180811_163514_163_LC16_down_maintain_yes.png");
    RgbImage out{read.cols / 4 * 4, read.rows / 4 * 4, {}};
    for (int y = 0; y < out.height; ++y)
      for (int x = 0; x < out.width; ++x)
        for (int c = 2; c >= 0; --c) out.rgb.push_back(read.at<cv::Vec3b>(y, x)[c]);
    return out;
  }();
  return image;
}

double megatexels(const RgbImage& image) {
  return 1e-6 * image.width * image.height;
}

void report(benchmark::State& state, std::size_t bytes, double decibels) {
  const RgbImage& image = seafloor();
  state.counters["ms/Mtexel"] =
      benchmark::Counter(1e-3 * megatexels(image) * static_cast<double>(state.iterations()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["bits/texel"] = 8e-6 * static_cast<double>(bytes) / megatexels(image);
  state.counters["PSNR_dB"] = decibels;
}

void outputPicture(benchmark::State& state, PictureConfig config) {
  config.quality = static_cast<int>(state.range(0));
  std::vector<std::uint8_t> bytes;
  const RgbImage& image = seafloor();
  for (auto _ : state) bytes = encodePicture(image, config);
  report(state, bytes.size(), psnr(decodePicture(bytes, "bench"), seafloor()));
}
BENCHMARK_CAPTURE(outputPicture, jpeg, PictureConfig{})
    ->DenseRange(60, 90, 10)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(outputPicture, jpeg420, PictureConfig{.half_chroma = true})
    ->Arg(80)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(outputPicture, webp0, PictureConfig{.format = PictureFormat::kWebp, .webp_effort = 0})
    ->DenseRange(60, 90, 10)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(outputPicture, webp1, PictureConfig{.format = PictureFormat::kWebp, .webp_effort = 1})
    ->DenseRange(60, 90, 10)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(outputPicture, webp4, PictureConfig{.format = PictureFormat::kWebp, .webp_effort = 4})
    ->Arg(75)
    ->Unit(benchmark::kMillisecond);

void outputBlocksWithMips(benchmark::State& state) {
  BlockTexture texture;
  const RgbImage& image = seafloor();
  for (auto _ : state) texture = compressBlocks(image);
  report(state, writeKtx2(texture).size(), psnr(decompressBlocks(texture, 0), seafloor()));
}
BENCHMARK(outputBlocksWithMips)->Unit(benchmark::kMillisecond);

void outputBlocksZstd(benchmark::State& state) {
  const BlockTexture texture = compressBlocks(seafloor());
  std::vector<std::uint8_t> bytes;
  for (auto _ : state) bytes = writeKtx2(texture, Supercompression::kZstd);
  report(state, bytes.size(), psnr(decompressBlocks(texture, 0), seafloor()));
}
BENCHMARK(outputBlocksZstd)->Unit(benchmark::kMillisecond);

// The peer, without mip levels.
void outputSquish(benchmark::State& state, int fit) {
  const RgbImage& image = seafloor();
  std::vector<std::uint8_t> rgba;
  for (std::size_t k = 0; k < image.rgb.size(); k += 3) {
    rgba.insert(rgba.end(), image.rgb.begin() + static_cast<std::ptrdiff_t>(k),
                image.rgb.begin() + static_cast<std::ptrdiff_t>(k) + 3);
    rgba.push_back(255);
  }
  BlockTexture texture{image.width, image.height, {{}}};
  texture.levels[0].resize(
      static_cast<std::size_t>(squish::GetStorageRequirements(image.width, image.height, squish::kDxt1)));
  for (auto _ : state)
    squish::CompressImage(rgba.data(), image.width, image.height, texture.levels[0].data(),
                          squish::kDxt1 | fit);
  report(state, texture.levels[0].size(), psnr(decompressBlocks(texture, 0), image));
}
BENCHMARK_CAPTURE(outputSquish, range, squish::kColourRangeFit)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(outputSquish, cluster, squish::kColourClusterFit)->Unit(benchmark::kMillisecond);

// Draco: a tile of 1000 triangles a square metre.
void outputSurface(benchmark::State& state) {
  test::SyntheticModel model{.texels = 0};
  const TexturedTile tile = model.tile({0, 0, 0});
  GlbConfig config;
  config.draco.speed = static_cast<int>(state.range(0));
  std::vector<std::uint8_t> bytes;
  for (auto _ : state) bytes = writeGlb(tile, model.grid, config);
  state.counters["bytes/triangle"] =
      static_cast<double>(bytes.size()) / static_cast<double>(tile.surface.mesh.triangles.size());
}
BENCHMARK(outputSurface)->Arg(0)->Arg(3)->Arg(5)->Arg(7)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace fathom::topside
