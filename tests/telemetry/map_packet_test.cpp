#include "telemetry/map/map_packet.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "realtime/kernel/memory/heap_counter.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {
namespace {

// Rolling ground with rubble: a square of side x side blocks at 25 cm.
std::vector<MapBlock> rubble(int side, double rough = 0.05, std::int32_t north = -30, std::int32_t east = 52,
                             double depth = 20, SpacingCode spacing = 5) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, rough);
  std::vector<MapBlock> blocks;
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      MapBlock block{.key = {spacing, north + r, east + c}, .seen = 0xFFFF, .sigma = 0.02F};
      for (int n = 0; n < MapBlock::kNodes; ++n) {
        const double x = (4 * r + n / 4) * 0.25, y = (4 * c + n % 4) * 0.25;
        block.depth[static_cast<std::size_t>(n)] =
            static_cast<float>(depth + 0.2 * x + 0.3 * std::sin(x + 2 * y) + noise(random));
        block.colour[static_cast<std::size_t>(n)] = {static_cast<std::uint8_t>(60 + 10 * (n % 4)), 90, 70};
      }
      blocks.push_back(block);
    }
  }
  return blocks;
}

const MapBlock* find(const DecodedMapPacket& packet, const BlockKey& key) {
  for (const MapBlock& block : packet.blocks)
    if (block.key == key) return &block;
  return nullptr;
}

void expectHeld(std::span<const MapBlock> sent, const DecodedMapPacket& packet, double max_error) {
  ASSERT_EQ(packet.blocks.size(), sent.size());
  for (const MapBlock& block : sent) {
    const MapBlock* got = find(packet, block.key);
    ASSERT_NE(got, nullptr);
    EXPECT_EQ(got->seen, block.seen);
    for (int n = 0; n < MapBlock::kNodes; ++n) {
      if (!block.isSeen(n)) continue;
      const auto k = static_cast<std::size_t>(n);
      EXPECT_LE(std::abs(static_cast<double>(got->depth[k]) - static_cast<double>(block.depth[k])),
                max_error);
    }
  }
}

class MapPacket : public testing::Test {
 protected:
  MapPacketEncoder encoder;
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
};

TEST_F(MapPacket, HoldsTheLongestPrefixThatFitsWithinTheErrorAndSaysWhatTheOtherSideHas) {
  const auto blocks = rubble(12);
  for (const std::size_t size : {22U, 54U, 118U, 246U}) {
    std::vector<std::uint8_t> out(size);
    std::vector<MapBlock> held(blocks.size());
    const auto result = encoder.encode(blocks, {.max_error = 0.05, .colour_bits = 0}, out, held);
    ASSERT_GT(result.blocks, 0U);
    ASSERT_LE(result.bytes, size);
    ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
    EXPECT_EQ(spacingOf(packet.spacing), 0.25);
    expectHeld(std::span(blocks).first(result.blocks), packet, 0.05);
    for (std::size_t k = 0; k < result.blocks; ++k) {
      const MapBlock* got = find(packet, blocks[k].key);
      ASSERT_NE(got, nullptr);
      EXPECT_EQ(got->depth, held[k].depth);
    }
  }
}

TEST_F(MapPacket, KeepsHolesSmallErrorsFarPlacesAndOtherSpacings) {
  auto blocks = rubble(6, 0.3, -40'000'000, 50'000'000, -5, kPowerCodes + 300);
  std::mt19937 random(3);
  for (auto& block : blocks) block.seen = static_cast<std::uint16_t>(random());
  blocks[0].seen |= 1;
  for (const double error : {0.001, 0.02, 0.2, 0.9}) {
    std::vector<std::uint8_t> out(2000);
    const auto result = encoder.encode(blocks, {.max_error = error, .colour_bits = 4}, out);
    ASSERT_EQ(result.blocks, blocks.size());
    ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
    EXPECT_TRUE(packet.has_colour);
    EXPECT_EQ(packet.spacing, blocks[0].key.spacing);
    expectHeld(blocks, packet, error);
  }
}

TEST_F(MapPacket, RefusesWhatCannotBeSentAndSurvivesAnyBytes) {
  auto blocks = rubble(2);
  std::vector<std::uint8_t> out(246);
  EXPECT_EQ(encoder.encode({}, {}, out).bytes, 0U);
  EXPECT_EQ(encoder.encode(blocks, {}, std::span(out).first(2)).bytes, 0U);
  blocks[0].depth[0] = std::nanf("");
  EXPECT_EQ(encoder.encode(blocks, {}, out).bytes, 0U);
  EXPECT_FALSE(decoder.decode({}, packet));
  std::mt19937 random(11);
  for (int k = 0; k < 3000; ++k) {
    std::vector<std::uint8_t> bytes(random() % 250);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    if (!decoder.decode(bytes, packet)) continue;
    EXPECT_LE(packet.blocks.size(), kMaxPacketBlocks);
    for (const auto& block : packet.blocks)
      for (const float depth : block.depth) EXPECT_TRUE(std::isfinite(depth));
  }
}

TEST_F(MapPacket, BlocksOfWhichNothingIsSeenGoAloneAndWithOthers) {
  auto blocks = rubble(2);
  std::vector<std::uint8_t> out(246);
  for (const std::size_t emptied : {std::size_t{1}, blocks.size()}) {
    for (std::size_t k = 0; k < emptied; ++k) blocks[k].seen = 0;
    const auto result = encoder.encode(blocks, {}, out);
    ASSERT_GT(result.blocks, 0U);
    ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
    ASSERT_EQ(packet.blocks.size(), result.blocks);
    const auto found = std::find_if(packet.blocks.begin(), packet.blocks.end(),
                                    [&](const MapBlock& b) { return b.key == blocks[0].key; });
    ASSERT_NE(found, packet.blocks.end());
    EXPECT_EQ(found->seen, 0);
  }
  const auto alone = encoder.encode(std::span(blocks).first(1), {}, out);
  EXPECT_EQ(alone.blocks, 1U);
  EXPECT_LE(alone.bytes, 8U);
}

TEST_F(MapPacket, HoldsTheErrorOnStepsSpikesSlopesAndExtremeDepths) {
  const auto depth = [](int kind, int i, int j) -> double {
    switch (kind) {
      case 0:
        return i < 9 ? 12 : 31.7;  // a cliff
      case 1:
        return (i * 7 + j * 13) % 11 == 0 ? 3 : 6;  // spikes
      case 2:
        return 40 + 1.9 * i - 0.7 * j;  // a steep slope
      case 3:
        return 10'900 + 0.1 * i;  // the deepest trench
      default:
        return -0.4;  // above the surface, flat
    }
  };
  for (int kind = 0; kind < 5; ++kind) {
    for (const double error : {0.02, 0.05, 0.17}) {
      std::vector<MapBlock> blocks = rubble(5);
      for (MapBlock& block : blocks)
        for (int n = 0; n < MapBlock::kNodes; ++n)
          block.depth[static_cast<std::size_t>(n)] = static_cast<float>(
              depth(kind, block.key.north * 4 + n / 4 + 120, block.key.east * 4 + n % 4 - 208));
      std::vector<std::uint8_t> out(2000);
      const auto result = encoder.encode(blocks, {.max_error = error, .colour_bits = 0}, out);
      ASSERT_EQ(result.blocks, blocks.size()) << kind;
      ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
      expectHeld(blocks, packet, error);
    }
  }
}

TEST_F(MapPacket, SendsABlockTooRoughForOneFrameInPartsCoarsestNodesFirst) {
  std::vector<MapBlock> blocks = rubble(1);
  std::mt19937 random(5);
  for (float& depth : blocks[0].depth) depth = static_cast<float>(20 + 40.0 * random() / random.max());
  std::vector<MapBlock> held(1);
  std::array<std::uint8_t, kMinFrameBytes - kFrameOverhead> out;
  EXPECT_EQ(encoder.encode(blocks, {}, out, held).bytes, 0U);  // whole or not at all, unless asked
  std::uint16_t arrived = 0;
  for (int frames = 0; blocks[0].seen != 0; ++frames) {
    ASSERT_LT(frames, 4);
    const auto result = encoder.encode(blocks, {.in_parts = true}, out, held);
    ASSERT_EQ(result.blocks, 1U);
    ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
    ASSERT_EQ(packet.blocks.size(), 1U);
    EXPECT_EQ(packet.blocks[0].seen, held[0].seen);
    EXPECT_EQ(packet.blocks[0].isSeen(0), frames == 0);
    for (int n = 0; n < MapBlock::kNodes; ++n)
      if (packet.blocks[0].isSeen(n)) {
        EXPECT_NEAR(packet.blocks[0].depth[static_cast<std::size_t>(n)],
                    blocks[0].depth[static_cast<std::size_t>(n)], 0.05);
      }
    arrived = static_cast<std::uint16_t>(arrived | held[0].seen);
    blocks[0].seen = static_cast<std::uint16_t>(blocks[0].seen & ~held[0].seen);
  }
  EXPECT_EQ(arrived, 0xFFFF);
}

TEST_F(MapPacket, KeepsBrightnessToItsStepAndHueNearly) {
  auto blocks = rubble(4);
  for (MapBlock& block : blocks)
    for (int n = 0; n < MapBlock::kNodes; ++n) {
      const int shade = 90 + 4 * (block.key.east * 4 + n % 4 - 208) + (n * 37 + block.key.north * 11) % 23;
      block.colour[static_cast<std::size_t>(n)] = {static_cast<std::uint8_t>(shade - 30),
                                                   static_cast<std::uint8_t>(shade + 10),
                                                   static_cast<std::uint8_t>(shade)};
    }
  std::vector<std::uint8_t> out(1500);
  for (int bits = 1; bits <= 6; ++bits) {
    const auto result = encoder.encode(blocks, {.max_error = 0.05, .colour_bits = bits}, out);
    ASSERT_EQ(result.blocks, blocks.size());
    ASSERT_TRUE(decoder.decode(std::span(out).first(result.bytes), packet));
    ASSERT_TRUE(packet.has_colour);
    const int step = 256 >> bits;
    for (const MapBlock& block : blocks) {
      const MapBlock* got = find(packet, block.key);
      ASSERT_NE(got, nullptr);
      for (std::size_t n = 0; n < MapBlock::kNodes; ++n) {
        const auto luma = [](const Rgb& c) { return (c[0] + 2 * c[1] + c[2]) / 4; };
        EXPECT_NEAR(luma(got->colour[n]), luma(block.colour[n]), step / 2 + 3) << bits;
        EXPECT_NEAR(got->colour[n][1] - got->colour[n][0], 40, step + 4) << bits;
      }
    }
  }
}

TEST_F(MapPacket, IsTheSameBytesWhateverWasEncodedBefore) {
  const auto blocks = rubble(9, 0.08);
  MapPacketEncoder fresh, used;
  std::vector<std::uint8_t> a(246), b(246);
  for (int k = 0; k < 20; ++k)
    (void)used.encode(rubble(1 + k % 7, 0.02 * k), {.max_error = 0.01 * (1 + k)}, b);
  const auto one = fresh.encode(blocks, {}, a), two = used.encode(blocks, {}, b);
  EXPECT_EQ(one.blocks, two.blocks);
  EXPECT_EQ(one.bytes, two.bytes);
  EXPECT_EQ(a, b);
}

// The format's numbers in use: a change of them is a change of kMapPacketFormat.
TEST_F(MapPacket, KeepsItsFormat) {
  std::vector<MapBlock> blocks = rubble(2);
  for (MapBlock& block : blocks)
    for (int n = 0; n < MapBlock::kNodes; ++n)
      block.depth[static_cast<std::size_t>(n)] =
          20 + 0.25F * static_cast<float>((n * 5 + block.key.north + block.key.east) % 7);
  std::vector<std::uint8_t> out(246);
  const auto result = encoder.encode(blocks, {.max_error = 0.05, .colour_bits = 2}, out);
  std::uint32_t hash = 2166136261U;
  for (std::size_t k = 0; k < result.bytes; ++k) hash = (hash ^ out[k]) * 16777619U;
  EXPECT_EQ(kMapPacketFormat, 1);
  EXPECT_EQ(result.bytes, 49U);
  EXPECT_EQ(hash, 2384401840U);
}

TEST_F(MapPacket, AnyBeginningOfAPacketDecodesToNoMoreThanItsBoundsOrIsRefused) {
  const auto blocks = rubble(6);
  std::vector<std::uint8_t> out(246);
  const auto result = encoder.encode(blocks, {.max_error = 0.05, .colour_bits = 3}, out);
  ASSERT_GT(result.bytes, 0U);
  EXPECT_NE(out[result.bytes - 1], 0);  // zeros at the end are implied
  for (std::size_t n = 0; n < result.bytes; ++n) {
    if (!decoder.decode(std::span(out).first(n), packet)) continue;
    EXPECT_LE(packet.blocks.size(), kMaxPacketBlocks);
    for (const MapBlock& block : packet.blocks)
      for (const float depth : block.depth) EXPECT_TRUE(std::isfinite(depth));
  }
}

TEST_F(MapPacket, EncodesAndDecodesWithoutTheHeap) {
  const auto blocks = rubble(12);
  packet.blocks.reserve(kMaxPacketBlocks);
  std::vector<std::uint8_t> out(246);
  std::vector<MapBlock> held(blocks.size());
  const rt::ThreadCost before = rt::threadCost();
  const auto result = encoder.encode(blocks, {.max_error = 0.05, .colour_bits = 3}, out, held);
  const bool good = decoder.decode(std::span(out).first(result.bytes), packet);
  const rt::ThreadCost cost = rt::threadCost() - before;
  EXPECT_TRUE(good);
  EXPECT_EQ(cost.heap_calls, 0U);
}

}  // namespace
}  // namespace fathom::telemetry
