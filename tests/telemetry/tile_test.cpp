#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "telemetry/tiles/tile_codec.hpp"
#include "telemetry/wire/field.hpp"
#include "tests/telemetry/sample_tile.hpp"

namespace fathom::telemetry {
namespace {

// A tile as a vehicle of an earlier version sent it: every stride-th node of `sent`, depths in steps of 2 cm.
struct RecordedTile {
  HeightTile sent;
  int stride, colour_bits;
  const char* hex;
  [[nodiscard]] std::vector<std::uint8_t> bytes() const {
    std::vector<std::uint8_t> out;
    for (const char* digits = hex; *digits != 0; digits += 2)
      out.push_back(static_cast<std::uint8_t>(std::stoi(std::string(digits, 2), nullptr, 16)));
    return out;
  }
};

// Depths from -5 to 595 m, of nodes without any order.
HeightTile scatteredTile() {
  HeightTile tile = sampleTile(0, 0);
  for (int k = 0; k < HeightTile::kNodes; ++k) {
    HeightTile::Node& node = tile.nodes[static_cast<std::size_t>(k)];
    node.coverage = k * k / 7 % 3 == 0 ? 1.0F : 0.0F;
    node.depth = static_cast<float>(-5 + k * 37 % 6000 / 10.0);
  }
  return tile;
}

// Whole ones, one whose unseen nodes are given as runs, and one where they are given node by node.
std::vector<RecordedTile> recordedTiles() {
  return {
      {sampleTile(0, 0), 2, 3,
       "00f9f413670001f0c0240001071fcd1e0d0be109c901c50231019501fc3101340364079834640734073403340b340334"
       "67eca0bb569b762bea5dd4332e50c2154b718032fe1cce964c78d95296f95368562115575c3a13c03ad74df64c5de642"
       "e39294c42660c74020f9cc2ae86b9e5202eb827b86687316c35e4f0149a944159420c4721dfedb2c9726605af379364c"
       "a1bbf8ea937b5f80"},
      {sampleTile(0, 0), 8, 6,
       "00f9fc13c70001f4408b0000070f390e5515751c04615f3a8d801b4606000a12f4e014b210c8083405a805017140e4d8"
       "01"},
      {sampleTile(0, 0, 4.0, 0.6), 4, 1,
       "00f9f813270001f2308119801600010616212e03e101d502d50207f0d50203c503f023e1011060568907728923ad83da"
       "29cf65d9135e"},
      {scatteredTile(), 1, 0,
       "00f9f013077fff831c909093e49f24f92121274849be48527c824f9f24249091093e9f244f922127e4849e4840a07301"
       "06853484ffffffffd784e37d0c0d0effffffffffffffffffffff87e509050dffffffffffffffffffffff8715022103ff"
       "ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff5384e30d"
       "01ffffffffffffffffffffa384e39101ffffffffffc39101ffffffffffc384ffffffffffc39d0231268d553ae6bf37c7"
       "967ed3d13c9eee065a9c02fdbb75be87e3a03a03258a9c52fe55e945012d7c6f8057ef21657d188086"},
  };
}

void expectSame(const RecordedTile& recorded, const DecodedTile& got) {
  EXPECT_EQ(got.stride, recorded.stride);
  EXPECT_EQ(got.colour_bits, recorded.colour_bits);
  EXPECT_DOUBLE_EQ(got.depth_resolution, 0.02);
  EXPECT_DOUBLE_EQ(got.tile.size, recorded.sent.size);
  for (int i = 0; i < HeightTile::kSide; ++i) {
    for (int j = 0; j < HeightTile::kSide; ++j) {
      const bool on_lattice = i % got.stride == 0 && j % got.stride == 0;
      const HeightTile::Node &a = recorded.sent.at(i, j), &b = got.tile.at(i, j);
      ASSERT_EQ(b.coverage > 0, on_lattice && a.coverage > 0) << i << " " << j;
      if (b.coverage <= 0) continue;
      ASSERT_NEAR(a.depth, b.depth, 0.01 + 1e-4);
      ASSERT_NEAR(std::log2(static_cast<double>(b.sigma) / 0.012), 0, 0.13);
      if (got.colour_bits == 0) continue;
      // Half a step of luma and a quarter of each of two chromas.
      const double step = 255.0 / ((1 << got.colour_bits) - 1);
      for (std::size_t c = 0; c < 3; ++c) ASSERT_NEAR(a.colour[c], b.colour[c], step + 1);
    }
  }
}

TEST(TileCodec, ReadsRecordedTilesOfEveryStrideColourAndMask) {
  for (const RecordedTile& recorded : recordedTiles()) {
    DecodedTile got;
    ASSERT_TRUE(decodeTile(recorded.bytes(), got));
    expectSame(recorded, got);
  }
}

TEST(TileCodec, TruncatedAtAnyByteIsRejected) {
  for (const RecordedTile& recorded : recordedTiles()) {
    const auto bytes = recorded.bytes();
    for (std::size_t n = 0; n < bytes.size(); ++n) {
      DecodedTile got;
      EXPECT_FALSE(decodeTile(std::span(bytes).first(n), got)) << n;
    }
  }
}

TEST(TileCodec, RandomAndDamagedBytesNeverGiveValuesOutsideTheLattice) {
  std::mt19937 random(21);
  const auto good = recordedTiles()[0].bytes();
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

// The first recorded tile, as a tile of this place, in fragments for frames of this size.
std::vector<std::vector<std::uint8_t>> fragments(std::int32_t north, std::int32_t east,
                                                 std::size_t frame_bytes, std::uint16_t revision = 1) {
  const auto tile = recordedTiles()[0].bytes();
  const std::size_t piece = frame_bytes - kFrameOverhead - kFragmentHeaderBytes;
  const std::size_t count = (tile.size() + piece - 1) / piece;
  std::vector<std::vector<std::uint8_t>> out;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<std::uint8_t> payload(kFragmentHeaderBytes);
    BitWriter w(payload);
    w.put(3, 4);  // level
    w.putSigned(north, 15);
    w.putSigned(east, 15);
    w.put(revision, kRevisionBits);
    w.put(1, 2);  // log2 of the stride
    w.put(i, 7);
    w.put(count, 7);
    const auto rest = std::span(tile).subspan(i * piece);
    const auto sent = rest.first(std::min(piece, rest.size()));
    payload.insert(payload.end(), sent.begin(), sent.end());
    out.push_back(payload);
  }
  return out;
}

TEST(TileReassembler, CompletesATileFromAnyOrderWithRepeats) {
  std::mt19937 random(1);
  for (const std::size_t frame_bytes : {32U, 64U, 256U}) {
    auto pieces = fragments(-16384, 16383, frame_bytes, 99);
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
    expectSame(recordedTiles()[0], got);
    EXPECT_EQ(reassembler.counters().repeated, pieces.size() / 2);
  }
}

TEST(TileReassembler, ManyTilesAtOnceComeOutWholeUnderLossAndReordering) {
  std::mt19937 random(6);
  std::vector<std::vector<std::uint8_t>> all;
  for (int n = 0; n < 20; ++n)
    for (const auto& piece : fragments(n, -n, 48)) all.push_back(piece);
  TileReassembler reassembler(32);
  DecodedTile got;
  std::size_t completed = 0;
  for (int pass = 0; pass < 12; ++pass) {  // without acknowledgements: passes with 30 % loss
    std::shuffle(all.begin(), all.end(), random);
    for (const auto& piece : all) {
      if (random() % 10 < 3 || !reassembler.accept(piece, got)) continue;
      ++completed;
      EXPECT_EQ(got.tile.north_index, -got.tile.east_index);
      expectSame(recordedTiles()[0], got);
    }
  }
  EXPECT_EQ(completed, 20U);
  EXPECT_EQ(reassembler.counters().conflicting + reassembler.counters().undecodable, 0U);
}

TEST(TileReassembler, NeverHoldsMoreThanItsFixedNumberOfOpenTiles) {
  TileReassembler reassembler(4);
  DecodedTile got;
  for (int n = 0; n < 50; ++n) (void)reassembler.accept(fragments(n, 0, 64)[0], got);
  EXPECT_EQ(reassembler.open(), 4);
  EXPECT_EQ(reassembler.counters().evicted, 46U);
}

TEST(TileReassembler, ANewerRevisionDropsTheOpenOlderOne) {
  TileReassembler reassembler(8);
  DecodedTile got;
  const auto old_pieces = fragments(0, 0, 128, 5);
  const auto new_pieces = fragments(0, 0, 128, 6);
  for (std::size_t i = 0; i + 1 < old_pieces.size(); ++i)
    EXPECT_FALSE(reassembler.accept(old_pieces[i], got));
  bool complete = false;
  for (const auto& piece : new_pieces) complete = reassembler.accept(piece, got);
  EXPECT_TRUE(complete);
  EXPECT_EQ(got.tile.revision, 6U);
  expectSame(recordedTiles()[0], got);
  EXPECT_EQ(reassembler.counters().superseded, 1U);
}

TEST(TileReassembler, CountsWhatIsNotAFragmentAndWhatDoesNotBelongTogether) {
  TileReassembler reassembler(8);
  DecodedTile got;
  auto pieces = fragments(0, 0, 64);
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
