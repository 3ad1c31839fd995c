#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "telemetry/tiles/tile_codec.hpp"
#include "telemetry/tiles/tile_fragments.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {
namespace {

std::vector<std::uint8_t> encoded(const HeightTile& tile, int stride, const TileCodecConfig& config = {}) {
  std::vector<std::uint8_t> out(kMaxTileBytes);
  out.resize(encodeTile(tile, stride, config, out));
  return out;
}

void expectSame(const HeightTile& sent, const DecodedTile& got, int stride, const TileCodecConfig& config) {
  EXPECT_EQ(got.stride, stride);
  EXPECT_DOUBLE_EQ(got.tile.size, sent.size);
  for (int i = 0; i < HeightTile::kSide; ++i) {
    for (int j = 0; j < HeightTile::kSide; ++j) {
      const bool on_lattice = i % stride == 0 && j % stride == 0;
      const HeightTile::Node &a = sent.at(i, j), &b = got.tile.at(i, j);
      ASSERT_EQ(b.coverage > 0, on_lattice && a.coverage > 0) << i << " " << j;
      if (b.coverage <= 0) continue;
      ASSERT_NEAR(a.depth, b.depth, config.depth_resolution / 2 + 1e-4);
      if (config.colour_bits == 0) continue;
      // Half a step of luma and a quarter of each of two chromas.
      const double step = 255.0 / ((1 << config.colour_bits) - 1);
      for (std::size_t c = 0; c < 3; ++c) ASSERT_NEAR(a.colour[c], b.colour[c], step + 1);
    }
  }
}

TEST(TileCodec, RoundTripsEveryStrideColourAndCoverage) {
  for (const int stride : {1, 2, 4, 8}) {
    for (const int bits : {0, 1, 3, 6}) {
      for (const double seen : {1.0, 0.6, 0.1}) {
        TileCodecConfig config;
        config.colour_bits = bits;
        const HeightTile tile = sampleTile(-3, 5, 4.0, seen);
        const auto bytes = encoded(tile, stride, config);
        ASSERT_GT(bytes.size(), 0U);
        DecodedTile got;
        ASSERT_TRUE(decodeTile(bytes, got));
        expectSame(tile, got, stride, config);
      }
    }
  }
}

TEST(TileCodec, KeepsAnyPatternOfNodesAndExtremeDepths) {
  std::mt19937 random(8);
  for (int round = 0; round < 300; ++round) {
    HeightTile tile = sampleTile(0, 0);
    const unsigned density = random() % 11;
    for (auto& node : tile.nodes) {
      node.coverage = random() % 10 < density ? 1.0F : 0.0F;
      node.depth = static_cast<float>(-5 + static_cast<double>(random() % 6000) / 10);
    }
    TileCodecConfig config;
    config.colour_bits = 0;
    const auto bytes = encoded(tile, 1, config);
    const bool any =
        std::any_of(tile.nodes.begin(), tile.nodes.end(), [](const auto& n) { return n.coverage > 0; });
    ASSERT_EQ(bytes.size() > 0, any);
    DecodedTile got;
    if (!any) continue;
    ASSERT_TRUE(decodeTile(bytes, got));
    expectSame(tile, got, 1, config);
  }
}

TEST(TileCodec, SharedNodesOfNeighboursDecodeToTheSameDepth) {
  HeightTile south = sampleTile(0, 0), north = sampleTile(1, 0);
  for (int j = 0; j < HeightTile::kSide; ++j) south.at(HeightTile::kCells, j) = north.at(0, j);
  DecodedTile a, b;
  ASSERT_TRUE(decodeTile(encoded(south, 2), a));
  ASSERT_TRUE(decodeTile(encoded(north, 2), b));
  for (int j = 0; j < HeightTile::kSide; j += 2)
    EXPECT_EQ(a.tile.at(HeightTile::kCells, j).depth, b.tile.at(0, j).depth);
}

TEST(TileCodec, CarriesTheMedianSigmaWithinItsStep) {
  HeightTile tile = sampleTile(0, 0);
  for (auto& node : tile.nodes) node.sigma = 0.037F;
  DecodedTile got;
  ASSERT_TRUE(decodeTile(encoded(tile, 4), got));
  EXPECT_NEAR(std::log2(got.tile.at(0, 0).sigma / 0.037), 0, 0.13);
}

TEST(TileCodec, RefusesWhatItCannotCarry) {
  HeightTile tile = sampleTile(0, 0);
  EXPECT_TRUE(encoded(tile, 3).empty());
  EXPECT_TRUE(encoded(tile, 16).empty());
  tile.size = 4.00037;  // not whole millimetres: the lattice would shift
  EXPECT_TRUE(encoded(tile, 1).empty());
  tile = sampleTile(0, 0);
  tile.at(3, 3).depth = 5000;  // further than the differences reach
  EXPECT_TRUE(encoded(tile, 1).empty());
  tile = sampleTile(0, 0);
  tile.at(3, 3).depth = NAN;  // such a node is as good as unseen
  DecodedTile got;
  ASSERT_TRUE(decodeTile(encoded(tile, 1), got));
  EXPECT_EQ(got.tile.at(3, 3).coverage, 0);
  EXPECT_TRUE(encoded(HeightTile{}, 1).empty());
  std::array<std::uint8_t, 30> small{};
  EXPECT_EQ(encodeTile(sampleTile(0, 0), 1, {}, small), 0U);
}

TEST(TileCodec, TruncatedAtAnyByteIsRejected) {
  for (const double seen : {1.0, 0.5}) {
    const auto bytes = encoded(sampleTile(1, 1, 4.0, seen), 2);
    for (std::size_t n = 0; n < bytes.size(); ++n) {
      DecodedTile got;
      EXPECT_FALSE(decodeTile(std::span(bytes).first(n), got)) << n;
    }
  }
}

TEST(TileCodec, RandomAndDamagedBytesNeverGiveValuesOutsideTheLattice) {
  std::mt19937 random(21);
  const auto good = encoded(sampleTile(1, 1), 2);
  for (int round = 0; round < 4000; ++round) {
    auto bytes = good;
    const unsigned flips = 1 + random() % 4;
    for (unsigned i = 0; i < flips; ++i)
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
    DecodedTile got;
    if (!decodeTile(bytes, got)) continue;
    EXPECT_GT(got.tile.size, 0);
    for (const auto& node : got.tile.nodes) EXPECT_TRUE(std::isfinite(node.depth));
  }
}

std::vector<std::vector<std::uint8_t>> fragments(const HeightTile& tile, int stride,
                                                 std::size_t frame_bytes) {
  FragmentTile id;
  EXPECT_TRUE(makeTileId(tile, stride, id));
  const auto bytes = encoded(tile, stride);
  std::vector<std::vector<std::uint8_t>> out;
  for (int i = 0; i < fragmentCount(bytes.size(), frame_bytes); ++i) {
    std::vector<std::uint8_t> payload(kMaxFrameBytes);
    payload.resize(encodeFragment(id, bytes, i, frame_bytes, payload));
    EXPECT_LE(payload.size() + kFrameOverhead, frame_bytes);
    out.push_back(payload);
  }
  return out;
}

TEST(TileReassembler, CompletesATileFromAnyOrderWithRepeats) {
  std::mt19937 random(1);
  for (const std::size_t frame_bytes : {32U, 64U, 256U}) {
    const HeightTile tile = sampleTile(-16384, 16383, 4.0, 1.0, 1, 99);
    auto pieces = fragments(tile, 1, frame_bytes);
    const auto again = pieces;
    pieces.insert(pieces.end(), again.begin(), again.end());
    std::shuffle(pieces.begin(), pieces.end(), random);
    TileReassembler reassembler;
    DecodedTile got;
    int completed = 0;
    for (const auto& piece : pieces) completed += reassembler.accept(piece, got) ? 1 : 0;
    EXPECT_EQ(completed, 1);
    EXPECT_EQ(got.tile.north_index, -16384);
    EXPECT_EQ(got.tile.east_index, 16383);
    EXPECT_EQ(got.tile.level, 3);
    EXPECT_EQ(got.tile.revision, 99U);
    expectSame(tile, got, 1, {});
    EXPECT_EQ(reassembler.counters().repeated, pieces.size() / 2);
  }
}

TEST(TileReassembler, ManyTilesAtOnceComeOutWholeUnderLossAndReordering) {
  std::mt19937 random(6);
  std::vector<std::vector<std::uint8_t>> all;
  for (int n = 0; n < 20; ++n)
    for (const auto& piece : fragments(sampleTile(n, -n), 2, 48)) all.push_back(piece);
  TileReassembler reassembler(32);
  DecodedTile got;
  std::size_t completed = 0;
  for (int pass = 0; pass < 12; ++pass) {  // without acknowledgements: passes with 30 % loss
    std::shuffle(all.begin(), all.end(), random);
    for (const auto& piece : all) {
      if (random() % 10 < 3 || !reassembler.accept(piece, got)) continue;
      ++completed;
      expectSame(sampleTile(got.tile.north_index, got.tile.east_index), got, 2, {});
    }
  }
  EXPECT_EQ(completed, 20U);
  EXPECT_EQ(reassembler.counters().conflicting + reassembler.counters().undecodable, 0U);
}

TEST(TileReassembler, NeverHoldsMoreThanItsFixedNumberOfOpenTiles) {
  TileReassembler reassembler(4);
  DecodedTile got;
  for (int n = 0; n < 50; ++n) (void)reassembler.accept(fragments(sampleTile(n, 0), 1, 64)[0], got);
  EXPECT_EQ(reassembler.open(), 4);
  EXPECT_EQ(reassembler.counters().evicted, 46U);
}

TEST(TileReassembler, ANewerRevisionDropsTheOpenOlderOne) {
  TileReassembler reassembler(8);
  DecodedTile got;
  const auto old_pieces = fragments(sampleTile(0, 0, 4.0, 1.0, 1, 5), 1, 128);
  const auto new_pieces = fragments(sampleTile(0, 0, 4.0, 1.0, 2, 6), 1, 128);
  for (std::size_t i = 0; i + 1 < old_pieces.size(); ++i)
    EXPECT_FALSE(reassembler.accept(old_pieces[i], got));
  bool complete = false;
  for (const auto& piece : new_pieces) complete = reassembler.accept(piece, got);
  EXPECT_TRUE(complete);
  EXPECT_EQ(got.tile.revision, 6U);
  expectSame(sampleTile(0, 0, 4.0, 1.0, 2, 6), got, 1, {});
  EXPECT_EQ(reassembler.counters().superseded, 1U);
}

TEST(TileReassembler, CountsWhatIsNotAFragmentAndWhatDoesNotBelongTogether) {
  TileReassembler reassembler(8);
  DecodedTile got;
  auto pieces = fragments(sampleTile(0, 0), 1, 64);
  EXPECT_FALSE(reassembler.accept({}, got));
  EXPECT_FALSE(reassembler.accept(std::span(pieces[0]).first(kFragmentHeaderBytes), got));
  EXPECT_EQ(reassembler.counters().invalid, 2U);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (i == 1) pieces[i].pop_back();  // one piece shorter than the others
    EXPECT_FALSE(reassembler.accept(pieces[i], got));
  }
  EXPECT_EQ(reassembler.counters().conflicting, 1U);
}

TEST(Revision, WrapsLikeASerialNumber) {
  EXPECT_TRUE(newerRevision(1, 0));
  EXPECT_FALSE(newerRevision(0, 1));
  EXPECT_FALSE(newerRevision(7, 7));
  EXPECT_TRUE(newerRevision(3, (1 << kRevisionBits) - 2));
}

}  // namespace
}  // namespace fathom::telemetry
