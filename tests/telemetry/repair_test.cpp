#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

#include "telemetry/repair/repair.hpp"
#include "tests/telemetry/sample_frames.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::size_t kRoom = 54;  // payload of a 64 B frame

Bytes payloadOf(int n, std::mt19937& random) {
  Bytes bytes(static_cast<std::size_t>(10 + n % 40));
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() % 3 == 0 ? 0 : random());
  return bytes;
}

struct Repair {
  std::uint16_t first = 0;
  Bytes payload;
  std::uint8_t group = 0;
};

std::vector<Repair> all(RepairEncoder& encoder) {
  std::vector<Repair> repairs;
  std::array<std::uint8_t, kRoom> out;
  for (auto row = encoder.next(out); row.bytes > 0; row = encoder.next(out))
    repairs.push_back({static_cast<std::uint16_t>(row.first),
                       {out.begin(), out.begin() + static_cast<std::ptrdiff_t>(row.bytes)},
                       row.group});
  return repairs;
}

TEST(Repair, AnyKFramesOfAGroupGiveBackAllOfItAcrossTheWrapOfTheSequence) {
  std::mt19937 random(3);
  for (const int k : {1, 2, 17, 64}) {
    for (int trial = 0; trial < 10; ++trial) {
      RepairEncoder encoder;
      RepairDecoder decoder;
      std::map<std::uint16_t, Bytes> sent, got;
      for (int n = 0; n < k; ++n) {
        const auto sequence = static_cast<std::uint16_t>(65500 + n);
        sent[sequence] = payloadOf(n, random);
        encoder.source(static_cast<Version>(65500 + n), sent[sequence], true, 0.5, 2);
      }
      encoder.close(0.5, 2);
      const std::vector<Repair> repairs = all(encoder);
      ASSERT_GE(repairs.size(), static_cast<std::size_t>(k));
      // k frames chosen among all: members as they are, the rest repair frames.
      std::vector<std::size_t> chosen(static_cast<std::size_t>(k) + repairs.size());
      for (std::size_t i = 0; i < chosen.size(); ++i) chosen[i] = i;
      std::shuffle(chosen.begin(), chosen.end(), random);
      for (std::size_t i = 0; i < static_cast<std::size_t>(k); ++i) {
        if (chosen[i] < static_cast<std::size_t>(k)) {
          const auto sequence = static_cast<std::uint16_t>(65500 + chosen[i]);
          decoder.source(sequence, sent[sequence], true);
          got[sequence] = sent[sequence];
        } else {
          const Repair& r = repairs[chosen[i] - static_cast<std::size_t>(k)];
          EXPECT_EQ(decoder.repair(r.first, r.payload, r.group), RepairDecoder::Taken::kTaken);
        }
        decoder.solve([&](std::uint16_t sequence, std::span<const std::uint8_t> payload) {
          EXPECT_FALSE(got.contains(sequence));
          got[sequence] = {payload.begin(), payload.end()};
        });
      }
      EXPECT_EQ(got, sent) << k;
    }
  }
}

TEST(Repair, OneFrameTooFewGivesNothingAndAWrongOneIsNoticed) {
  std::mt19937 random(5);
  RepairEncoder encoder;
  for (int n = 0; n < 20; ++n)
    encoder.source(static_cast<std::uint16_t>(n), payloadOf(n, random), true, 0.3, 1);
  encoder.close(0.3, 1);
  std::vector<Repair> repairs = all(encoder);
  ASSERT_GE(repairs.size(), 8U);
  RepairDecoder decoder;
  std::mt19937 again(5);
  for (int n = 0; n < 20; ++n) {
    const Bytes payload = payloadOf(n, again);
    if (n >= 5) decoder.source(static_cast<std::uint16_t>(n), payload, true);
  }
  int given = 0;
  const auto count = [&](std::uint16_t, std::span<const std::uint8_t>) { ++given; };
  for (int r = 0; r < 4; ++r) {
    EXPECT_EQ(decoder.repair(repairs[static_cast<std::size_t>(r)].first,
                             repairs[static_cast<std::size_t>(r)].payload),
              RepairDecoder::Taken::kTaken);
    decoder.solve(count);
  }
  EXPECT_EQ(decoder.repair(repairs[0].first, repairs[0].payload), RepairDecoder::Taken::kDuplicate);
  EXPECT_EQ(given, 0);
  repairs[4].payload.back() ^= 0x5A;  // in the padding, which must be zero
  EXPECT_EQ(decoder.repair(repairs[4].first, repairs[4].payload), RepairDecoder::Taken::kTaken);
  decoder.solve(count);
  EXPECT_EQ(given, 0);
  EXPECT_EQ(decoder.counters().contradicted, 1U);
}

TEST(Repair, MessagesThatAreNotMapLeaveNoHoleInAGroup) {
  std::mt19937 random(6);
  RepairEncoder encoder;
  RepairDecoder decoder;
  std::map<std::uint16_t, Bytes> lost;
  for (int n = 0; n < 30; ++n) {
    const auto sequence = static_cast<std::uint16_t>(n);
    const Bytes payload = payloadOf(n, random);
    const bool is_map = n == 0 || n % 3 != 0;
    encoder.source(sequence, payload, is_map, 0.3, 1);
    if (n % 4 == 1 && is_map) lost[sequence] = payload;
    if (n % 4 != 1) decoder.source(sequence, payload, is_map);
  }
  encoder.close(0.3, 1);
  std::map<std::uint16_t, Bytes> got;
  for (const Repair& r : all(encoder)) {
    EXPECT_EQ(decoder.repair(r.first, r.payload, r.group), RepairDecoder::Taken::kTaken);
    decoder.solve([&](std::uint16_t sequence, std::span<const std::uint8_t> payload) {
      got[sequence] = {payload.begin(), payload.end()};
    });
  }
  EXPECT_EQ(got, lost);
}

TEST(Repair, RowsGrowWithTheLossAndMoreForBursts) {
  EXPECT_EQ(repairRows(64, 0, 1), 0);
  int last = 0;
  for (const double loss : {0.05, 0.1, 0.3, 0.5}) {
    const int rows = repairRows(64, loss, 1 / (1 - loss));
    EXPECT_GT(rows, last);
    EXPECT_GE((64 + rows) * (1 - loss), 64);
    EXPECT_LE(64 + rows, 1.3 * 64 / (1 - loss)) << loss;
    EXPECT_GT(repairRows(64, loss, 5), rows);
    last = rows;
  }
}

TEST(Repair, RepairFramesOfAGroupAreSpreadOverTheNext) {
  std::mt19937 random(8);
  RepairEncoder encoder;
  std::array<std::uint8_t, kRoom> out;
  int run = 0, longest = 0, repairs = 0;
  for (int n = 0; n < 3 * kMaxGroup; ++n) {
    for (run = 0; encoder.due(); ++run, ++repairs) ASSERT_GT(encoder.next(out).bytes, 0U);
    longest = std::max(longest, run);
    encoder.source(static_cast<std::uint16_t>(n), payloadOf(n, random), true, 0.3, 1.4);
  }
  EXPECT_LE(longest, 1);
  EXPECT_NEAR(repairs, 2 * repairRows(64, 0.3, 1.4), 2);
}

// Numbers used twice, with other frames: what their repair frames would give together was never sent.
TEST(Repair, WhatIsRepairedIsWhatWasSentWhenNumbersComeAgain) {
  std::mt19937 random(5);
  std::vector<std::vector<Repair>> repairs;
  std::vector<std::vector<Bytes>> sent;
  for (int life = 0; life < 2; ++life) {
    RepairEncoder encoder;
    sent.emplace_back();
    for (int n = 0; n < 8; ++n) {
      sent.back().push_back(Bytes(30));
      for (auto& byte : sent.back().back()) byte = static_cast<std::uint8_t>(random());
      encoder.source(static_cast<Version>(n), sent.back().back(), true, 0.3, 1);
    }
    encoder.close(0.3, 1);
    repairs.push_back(all(encoder));
  }
  RepairDecoder decoder;
  std::vector<Bytes> given;
  const auto solve = [&] {
    decoder.solve([&](std::uint16_t, std::span<const std::uint8_t> payload) {
      given.emplace_back(payload.begin(), payload.end());
    });
  };
  // Of the first life seven frames, of the second the repair frames; then one repair frame of the first.
  for (std::size_t n = 1; n < 8; ++n) decoder.source(static_cast<std::uint16_t>(n), sent[0][n], true);
  for (std::size_t r = 0; r < 2; ++r) {
    EXPECT_EQ(decoder.repair(0, repairs[1][r].payload, repairs[1][r].group), RepairDecoder::Taken::kTaken);
    solve();
  }
  EXPECT_TRUE(given.empty());
  EXPECT_GT(decoder.counters().contradicted, 0U);
  EXPECT_EQ(decoder.repair(0, repairs[0][0].payload, repairs[0][0].group), RepairDecoder::Taken::kTaken);
  solve();
  ASSERT_EQ(given.size(), 1U);
  EXPECT_EQ(given[0], sent[0][0]);
}

TEST(RepairDecoder, TakesAnyBytesAndStaysBounded) {
  std::mt19937 random(9);
  RepairDecoder decoder;
  const std::size_t memory = decoder.memoryBytes();
  for (int n = 0; n < 3000; ++n) {
    Bytes bytes(random() % 250);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() % 4);
    const auto sequence = static_cast<std::uint16_t>(random() % 200);
    if (random() % 2 == 0)
      decoder.source(sequence, bytes, random() % 2 == 0);
    else
      decoder.repair(sequence, bytes);
    decoder.solve([](std::uint16_t, std::span<const std::uint8_t> payload) {
      EXPECT_LE(payload.size(), kMaxSymbolBytes);
    });
  }
  EXPECT_EQ(decoder.memoryBytes(), memory);
}

}  // namespace
}  // namespace fathom::telemetry
