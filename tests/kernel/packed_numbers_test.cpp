#include "realtime/kernel/packed_numbers.hpp"

#include <gtest/gtest.h>

#include <random>

namespace fathom::rt {
namespace {

std::size_t bytesOf(const EightNumbers& numbers) {
  std::array<std::uint8_t, kMostPacked> bytes{};
  const std::size_t size = packNumbers(numbers, bytes.data());
  std::uint32_t lengths = 0;
  std::memcpy(&lengths, bytes.data(), sizeof lengths);
  EXPECT_EQ(kPackedHead + packedBytes(lengths), size);
  EXPECT_EQ(unpackNumbers(lengths, bytes.data() + kPackedHead), numbers);
  return size;
}

TEST(PackedNumbers, TakeAsManyBytesAsTheyNeed) {
  EXPECT_EQ(bytesOf({}), kPackedHead);
  EXPECT_EQ(bytesOf({1, 255, 0, 0, 0, 0, 0, 0}), kPackedHead + 2);
  EXPECT_EQ(bytesOf({256, 65535, 65536, 0, 0, 0, 0, 1}), kPackedHead + 2 + 2 + 3 + 1);
  EightNumbers largest;
  largest.fill(~std::uint64_t{0});
  EXPECT_EQ(bytesOf(largest), kMostPacked);
}

TEST(PackedNumbers, AnyNumbersComeBack) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 1000; ++k) {
    EightNumbers numbers;
    for (std::uint64_t& n : numbers) n = random() >> (random() % 64);
    (void)bytesOf(numbers);
  }
}

TEST(PackedNumbers, ANumberOfMoreThanEightBytesIsNone) {
  EXPECT_EQ(packedBytes(0x00000009), kMostPacked);
  EXPECT_EQ(packedBytes(0xF0000000), kMostPacked);
}

}  // namespace
}  // namespace fathom::rt
