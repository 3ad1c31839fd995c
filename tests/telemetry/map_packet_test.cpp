#include "telemetry/map_packet.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

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
      MapBlock block;
      block.key = {spacing, north + r, east + c};
      block.seen = 0xFFFF;
      block.sigma = 0.02F;
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

TEST(MapPacket, HoldsTheLongestPrefixThatFitsWithinTheErrorAndSaysWhatTheOtherSideHas) {
  const auto blocks = rubble(12);
  MapPacketEncoder encoder;
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
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

TEST(MapPacket, KeepsHolesSmallErrorsFarPlacesAndOtherSpacings) {
  auto blocks = rubble(6, 0.3, -40'000'000, 50'000'000, -5, kPowerCodes + 300);
  std::mt19937 random(3);
  for (auto& block : blocks) block.seen = static_cast<std::uint16_t>(random());
  blocks[0].seen |= 1;
  MapPacketEncoder encoder;
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
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

TEST(MapPacket, RefusesWhatCannotBeSentAndSurvivesAnyBytes) {
  auto blocks = rubble(2);
  MapPacketEncoder encoder;
  std::vector<std::uint8_t> out(246);
  EXPECT_EQ(encoder.encode({}, {}, out).bytes, 0U);
  EXPECT_EQ(encoder.encode(blocks, {}, std::span(out).first(2)).bytes, 0U);
  blocks[0].depth[0] = std::nanf("");
  EXPECT_EQ(encoder.encode(blocks, {}, out).bytes, 0U);
  blocks[0].seen = 0;
  EXPECT_EQ(encoder.encode(blocks, {}, out).bytes, 0U);
  MapPacketDecoder decoder;
  DecodedMapPacket packet;
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

}  // namespace
}  // namespace fathom::telemetry
