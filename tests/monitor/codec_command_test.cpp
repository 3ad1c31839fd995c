#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "recon/geometry/ply.hpp"
#include "telemetry/monitor/codec/codec_program.hpp"
#include "tests/support/lattice_mesh.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::monitor {
namespace {

// A plane rising northwards with a rectangular hole.
Mesh plane(float north0, float east0) {
  constexpr int kSide = 41;
  constexpr float kStep = 0.1F;
  Mesh mesh;
  const auto n = [](int i, int j) { return static_cast<std::uint32_t>(i * kSide + j); };
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j)
      mesh.vertices.emplace_back(north0 + kStep * static_cast<float>(i),
                                 east0 + kStep * static_cast<float>(j), 8 + 0.02F * static_cast<float>(i));
  for (int i = 0; i + 1 < kSide; ++i) {
    for (int j = 0; j + 1 < kSide; ++j) {
      if (i >= 15 && i < 27 && j >= 15 && j < 27) continue;
      mesh.triangles.push_back({n(i, j), n(i, j + 1), n(i + 1, j + 1)});
      mesh.triangles.push_back({n(i, j), n(i + 1, j + 1), n(i + 1, j)});
    }
  }
  return mesh;
}

TEST(CodecSurface, SamplesHeightsWhereTheyAreAndLeavesHoles) {
  for (const Sampling sampling : {Sampling::kMap, Sampling::kPoint}) {
    const LatticeSurface surface = sampleSurface(plane(-3.02F, 100.03F), 0.25, sampling, "plane.ply");
    std::size_t seen = 0, holes = 0;
    for (int i = 0; i < surface.rows; ++i) {
      for (int j = 0; j < surface.cols; ++j) {
        const double north = (surface.north0 + i) * 0.25, east = (surface.east0 + j) * 0.25;
        const float depth = surface.depth[surface.at(i, j)];
        const bool inside = north > -2.7 && north < 0.6 && east > 100.4 && east < 103.7;
        const bool hole = north > -1.4 && north < -0.5 && east > 101.6 && east < 102.5;
        if (hole) {
          EXPECT_TRUE(std::isnan(depth));
          ++holes;
        } else if (!std::isnan(depth)) {
          ++seen;
          if (inside && std::abs(north + 0.92) > 1 && std::abs(east - 102.08) > 1) {
            EXPECT_NEAR(depth, 8 + 0.2 * (north + 3.02), 2e-3);
          }
        }
      }
    }
    EXPECT_EQ(seen, surface.seen);
    EXPECT_GT(seen, 200U);
    EXPECT_GT(holes, 8U);
  }
}

TEST(CodecSurface, TheMapsSamplingIsAMeanUnderATent) {
  // Ridges a cell apart: high at every node, half as high in the mean.
  Mesh mesh;
  constexpr int kSide = 81;
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j)
      mesh.vertices.emplace_back(
          0.05F * static_cast<float>(i), 0.05F * static_cast<float>(j),
          10 - 0.1F * static_cast<float>(std::abs(2.5 - (i + 0.0) + 5 * std::floor(i / 5.0))));
  mesh.triangles = test::latticeTriangles(kSide, kSide);
  const LatticeSurface point = sampleSurface(mesh, 0.25, Sampling::kPoint, "ridges.ply");
  const LatticeSurface map = sampleSurface(mesh, 0.25, Sampling::kMap, "ridges.ply");
  EXPECT_NEAR(point.depth[point.at(8, 8)], 9.75, 1e-3);
  EXPECT_NEAR(map.depth[map.at(8 + point.north0 - map.north0, 8 + point.east0 - map.east0)], 9.87, 0.02);
}

TEST(CodecSurface, BadMeshesAndCellsAreOneClearError) {
  EXPECT_THROW((void)sampleSurface({}, 0.25, Sampling::kMap, "a.ply"), InputError);
  EXPECT_THROW((void)sampleSurface(plane(0, 0), 0, Sampling::kMap, "a.ply"), InputError);
  EXPECT_THROW((void)sampleSurface(plane(0, 0), std::nan(""), Sampling::kMap, "a.ply"), InputError);
  EXPECT_THROW((void)sampleSurface(plane(0.3F, 0.3F), 64, Sampling::kPoint, "a.ply"), InputError);
  EXPECT_THROW((void)sampleSurface(plane(1e7F, 0), 0.001, Sampling::kPoint, "a.ply"), InputError);
  CodecOptions options{.terrain = "absent.ply"};
  EXPECT_THROW((void)runCodec(options), InputError);
  for (const double error : {0.0, -1.0, 5.0, std::numeric_limits<double>::quiet_NaN()}) {
    options.max_error = error;
    EXPECT_THROW((void)runCodec(options), InputError);
  }
  options.max_error = 0.05;
  options.frame = 31;
  EXPECT_THROW((void)runCodec(options), InputError);
}

TEST(CodecReport, EveryNodeComesBackWithinTheErrorAtAnyCellAndFrame) {
  for (const double cell : {0.25, 0.3, 0.125}) {
    const LatticeSurface surface = sampleSurface(plane(-3, 40), cell, Sampling::kMap, "plane.ply");
    for (const std::size_t frame : {32U, 256U}) {
      const CodecFigures figures = sendSurface(surface, {.max_error = 0.02, .frame = frame});
      EXPECT_EQ(figures.nodes, surface.seen);
      EXPECT_LE(figures.max_error, 0.02);
      EXPECT_LT(figures.bitsPerNode(), 8);
    }
  }
}

TEST(CodecReport, PeersHoldTheErrorThatTheyClaim) {
  const LatticeSurface surface = sampleSurface(plane(-3, 40), 0.25, Sampling::kMap, "plane.ply");
  const auto others = peers::allPeers(toLattice(surface), 0.03);
  ASSERT_EQ(others.size(), 4U);
  for (const auto& peer : others) {
    EXPECT_GT(peer.bytes, 0U) << peer.name;
    EXPECT_LE(peer.max_error, 0.03) << peer.name;
    EXPECT_LE(peer.nodes, surface.seen) << peer.name;
    EXPECT_GT(peer.nodes, surface.seen * 9 / 10) << peer.name;
  }
}

TEST(CodecReport, RealSeafloorTakesHalfOfWhatItsPeersTake) {
  FATHOM_REQUIRE_DATA("pavlopetri/chamber3.ply");
  const std::filesystem::path path = test::dataFile("pavlopetri/chamber3.ply");
  const LatticeSurface surface = sampleSurface(readPly(path), 0.25, Sampling::kMap, path);
  const CodecFigures figures = sendSurface(surface, {});
  EXPECT_LE(figures.max_error, 0.05);
  EXPECT_LE(figures.bytesPerArea(), 3.5);
  const peers::Lattice lattice = toLattice(surface);
  for (const auto& peer : {peers::dracoGrid(lattice, 0.05), peers::dracoWholeNumbers(lattice, 0.05)})
    EXPECT_LE(figures.bytes, peer.bytes / 2) << peer.name;
  for (const auto& peer :
       {peers::jpeg2000Reversible(lattice, 0.05), peers::jpeg2000Irreversible(lattice, 0.05)})
    EXPECT_LE(figures.bytes, peer.bytes) << peer.name;
  for (const int side : {9, 17}) {
    const TileFigures tiles = sendTiles(surface, side, {});
    EXPECT_GT(tiles.tiles, 10U);
    EXPECT_LE(tiles.max_bytes, side == 9 ? 64U : 200U);
  }
}

}  // namespace
}  // namespace fathom::monitor
