#include "telemetry/wire/field.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace fathom::telemetry {
namespace {

TEST(Field, TakesNoMoreBitsThanItsCodesNeed) {
  EXPECT_EQ((Field{0, 255, 1}.bits()), 8U);
  EXPECT_EQ((Field{0, 256, 1}.bits()), 9U);
  EXPECT_EQ((Field{0, 255, 1, true}.bits()), 9U);  // one more code for absent
  EXPECT_EQ((Field{5, 5, 1}.bits()), 0U);
}

TEST(Field, RoundTripsWithinHalfAStepIncludingBothBounds) {
  const Field field{-50, 6500, 0.05};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> values(field.min, field.max);
  for (int i = 0; i < 2000; ++i) {
    const double value = i == 0 ? field.min : i == 1 ? field.max : values(random);
    EXPECT_NEAR(field.decode(field.encode(value)), value, field.resolution / 2 + 1e-9);
  }
}

TEST(Field, SaturatesOutsideItsBoundsAndKeepsAbsentApart) {
  const Field plain{0, 10, 0.5}, optional{0, 10, 0.5, true};
  EXPECT_EQ(plain.decode(plain.encode(1e300)), 10);
  EXPECT_EQ(plain.decode(plain.encode(-INFINITY)), 0);
  EXPECT_EQ(plain.decode(plain.encode(NAN)), 0);
  EXPECT_TRUE(std::isnan(optional.decode(optional.encode(NAN))));
  EXPECT_FALSE(plain.valid(NAN));
  EXPECT_TRUE(optional.valid(NAN));
  EXPECT_FALSE(optional.valid(10.1));
}

TEST(BitPacking, ReadsBackEveryWidthUnaligned) {
  std::mt19937_64 random(5);
  std::array<std::uint8_t, 1024> buffer{};
  buffer.fill(0xFF);  // old content must not shine through
  std::vector<std::pair<std::uint64_t, unsigned>> written;
  BitWriter w(buffer);
  for (unsigned bits = 1; bits <= 64; ++bits) {
    const std::uint64_t value = random() >> (64 - bits);
    w.put(value, bits);
    written.emplace_back(value, bits);
  }
  ASSERT_TRUE(w.ok());
  BitReader r{std::span(buffer).first(w.bytes())};
  for (const auto& [value, bits] : written) EXPECT_EQ(r.get(bits), value);
  EXPECT_TRUE(r.finished());
}

TEST(BitPacking, SignedValuesSurviveAtTheirBounds) {
  std::array<std::uint8_t, 8> buffer{};
  BitWriter w(buffer);
  w.putSigned(-4, 3);
  w.putSigned(3, 3);
  w.putSigned(-1, 17);
  BitReader r(buffer);
  EXPECT_EQ(r.getSigned(3), -4);
  EXPECT_EQ(r.getSigned(3), 3);
  EXPECT_EQ(r.getSigned(17), -1);
}

TEST(BitPacking, StopsAtTheEndOfTheBuffer) {
  std::array<std::uint8_t, 2> buffer{};
  BitWriter w(buffer);
  w.put(1, 15);
  w.put(3, 2);
  EXPECT_FALSE(w.ok());
  BitReader r(buffer);
  (void)r.get(17);
  EXPECT_FALSE(r.ok());
}

}  // namespace
}  // namespace fathom::telemetry
