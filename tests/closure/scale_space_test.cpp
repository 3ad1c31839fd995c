#include "recon/closure/scale_space.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "realtime/base/numbers/hash64.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::closure {
namespace {

constexpr double kContrast = 0.02;

test::GrayImage blank(int width, int height) {
  return {width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width * height))};
}

std::uint8_t& at(test::GrayImage& picture, int x, int y) {
  return picture.pixels[static_cast<std::size_t>(y * picture.width + x)];
}

// Blocks of random greys of 8 and 2 pixels, by whole numbers alone.
test::GrayImage blocks(int width, int height) {
  test::GrayImage picture = blank(width, height);
  const auto grey = [](int x, int y, int side, std::uint64_t range) {
    return hash64(static_cast<std::uint64_t>(side * 100'000'000 + (y / side) * 10'000 + x / side)) % range;
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      at(picture, x, y) = static_cast<std::uint8_t>(40 + grey(x, y, 8, 100) + grey(x, y, 2, 60));
  return picture;
}

// A bright spot on grey that gets brighter towards one side.
test::GrayImage spot(double x0, double y0, double sigma, double direction) {
  test::GrayImage picture = blank(120, 100);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const double dx = x - x0, dy = y - y0;
      const double height = 12 * sigma * std::exp(-0.5 * (dx * dx + dy * dy) / (sigma * sigma)),
                   slope = 1.2 * (std::cos(direction) * dx - std::sin(direction) * dy);
      at(picture, x, y) = static_cast<std::uint8_t>(std::lround(100 + height + slope));
    }
  return picture;
}

TEST(ScaleSpace, FindsASpotWhereItIsAsLargeAsItIsAndTurnedAsItIs) {
  ScaleSpace scale_space(kContrast);
  double place = 0, least = 1, most = 1, turn = 0;
  for (const double sigma : {1.5, 2.0, 3.1, 5.0})
    for (const double direction : {0.0, 1.0, 2.5, 4.0, 6.0}) {
      const double x = 60.3, y = 48.8;
      const test::GrayImage picture = spot(x, y, sigma, direction);
      const auto& points = scale_space.detect(picture.view());
      ASSERT_FALSE(points.empty()) << sigma;
      const KeyPoint& p = points.front();
      place = std::max(place, std::hypot(static_cast<double>(p.x) - x, static_cast<double>(p.y) - y) / sigma);
      const double size = 0.5 * static_cast<double>(p.size) / sigma;
      least = std::min(least, size), most = std::max(most, size);
      double off = 1;  // of one of its directions
      for (const KeyPoint& q : points)
        if (q.x == p.x && q.y == p.y)
          off = std::min(off,
                         std::abs(std::remainder(static_cast<double>(q.turn) - direction / 6.2831853, 1.0)));
      turn = std::max(turn, off);
    }
  std::printf("off by %.3f sigma, %.3f to %.3f of its size, %.4f turns\n", place, least, most, turn);
  EXPECT_LT(place, 0.04);
  EXPECT_GT(least, 0.8);
  EXPECT_LT(most, 1.2);
  EXPECT_LT(turn, 0.1);
}

// By a quarter of a turn, which keeps every pixel, and by another grey and contrast.
TEST(ScaleSpace, DescribesTheSameAfterATurnAndInOtherLight) {
  const test::GrayImage picture = blocks(160, 120);
  test::GrayImage turned = blank(120, 160), dimmer = blank(160, 120);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const auto grey = picture.pixels[static_cast<std::size_t>(y * picture.width + x)];
      at(turned, y, picture.width - 1 - x) = grey;
      at(dimmer, x, y) = static_cast<std::uint8_t>(20 + grey / 2);
    }
  ScaleSpace first(kContrast), second(kContrast), third(kContrast / 2);
  const auto points = first.detect(picture.view());
  const auto &of_turned = second.detect(turned.view()), &of_dimmer = third.detect(dimmer.view());
  const auto share = [&](const ScaleSpace& other, const std::vector<KeyPoint>& others, bool is_turned) {
    int same = 0;
    for (std::size_t k = 0; k < 100; ++k) {
      const KeyPoint& p = points[k];
      const float x = is_turned ? p.y : p.x, y = is_turned ? 159 - p.x : p.y,
                  turn = is_turned ? p.turn + 0.25F : p.turn;
      std::array<float, ScaleSpace::kDescriptor> a{}, b{};
      first.describe(p, a);
      for (const KeyPoint& q : others) {
        if (std::hypot(q.x - x, q.y - y) > 0.2F || std::abs(std::remainder(q.turn - turn, 1.0F)) > 0.02F)
          continue;
        other.describe(q, b);
        double ab = 0, aa = 0, bb = 0;
        for (std::size_t i = 0; i < a.size(); ++i) {
          const auto va = static_cast<double>(a[i]), vb = static_cast<double>(b[i]);
          ab += va * vb, aa += va * va, bb += vb * vb;
        }
        if (ab > 0.98 * std::sqrt(aa * bb)) {
          ++same;
          break;
        }
      }
    }
    return same;
  };
  ASSERT_GT(points.size(), 200U);
  std::printf("%zu points; the same of 100: %d turned, %d dimmer\n", points.size(),
              share(second, of_turned, true), share(third, of_dimmer, false));
  EXPECT_GE(share(second, of_turned, true), 80);
  EXPECT_GE(share(third, of_dimmer, false), 80);
}

TEST(ScaleSpace, HasNoPointsInFlatTinyAndEmptyImages) {
  ScaleSpace scale_space(kContrast);
  EXPECT_TRUE(scale_space.detect({}).empty());
  for (const auto& [width, height] : {std::pair(1, 1), {7, 50}, {8, 8}, {9, 300}})
    scale_space.detect(blocks(width, height).view());
  test::GrayImage flat = blank(64, 64);
  std::fill(flat.pixels.begin(), flat.pixels.end(), std::uint8_t{90});
  EXPECT_TRUE(scale_space.detect(flat.view()).empty());
}

TEST(ScaleSpace, ReusedForAnotherImageGivesWhatAFreshOneGives) {
  const auto bytesOf = [](ScaleSpace& s, const test::GrayImage& picture) {
    std::vector<float> out;
    for (const KeyPoint& p : s.detect(picture.view())) {
      std::array<float, ScaleSpace::kDescriptor> d{};
      s.describe(p, d);
      out.insert(out.end(), {p.x, p.y, p.size, p.turn, p.response});
      out.insert(out.end(), d.begin(), d.end());
    }
    return out;
  };
  ScaleSpace reused(kContrast), fresh(kContrast);
  bytesOf(reused, blocks(201, 150));
  EXPECT_EQ(bytesOf(reused, blocks(90, 61)), bytesOf(fresh, blocks(90, 61)));
}

// The same numbers on every processor: FNV-1a of their bytes.
TEST(ScaleSpace, GivesTheSameBytesOnEveryProcessor) {
  std::uint64_t digest = 0xcbf29ce484222325;
  const auto add = [&](float v) { digest = (digest ^ std::bit_cast<std::uint32_t>(v)) * 0x100000001b3; };
  ScaleSpace scale_space(kContrast);
  const test::GrayImage picture = blocks(203, 149);
  for (const KeyPoint& p : scale_space.detect(picture.view())) {
    std::array<float, ScaleSpace::kDescriptor> d{};
    scale_space.describe(p, d);
    for (const float v : {p.x, p.y, p.size, p.turn, p.response}) add(v);
    for (const float v : d) add(v);
  }
  EXPECT_EQ(digest, 0xeeb2e12f993a6f29) << std::hex << digest;
}

TEST(ScaleKernels, AreTheSameInEveryInstructionSet) {
  const scale::ScaleKernels fastest = scale::fastestKernels(), baseline = scale::baselineKernels();
  constexpr int kMost = 131, kPad = 16;
  std::vector<std::vector<float>> rows;
  std::vector<const float*> middles;
  for (std::uint64_t r = 0; r < 2 * kPad + 1; ++r) {
    rows.emplace_back();
    for (std::uint64_t x = 0; x < kMost + 2 * kPad; ++x)
      rows.back().push_back(static_cast<float>(hash64(r, x) % 2048) / 8 - 128);
    middles.push_back(rows.back().data() + kPad);
  }
  const std::vector<float> weights = {0.3F, 0.2F, 0.11F, 0.04F, 0.01F};
  const auto same = [&](auto run, int n) {
    std::vector<float> a(2 * kMost), b(2 * kMost);
    run(fastest, a);
    run(baseline, b);
    EXPECT_EQ(a, b) << n;
  };
  for (const int n : {0, 1, 7, 8, 15, 16, 17, 64, kMost}) {
    same([&](const scale::ScaleKernels& k,
             auto& out) { k.blurAlong(middles[0], weights.data(), 4, n, out.data()); },
         n);
    same([&](const scale::ScaleKernels& k,
             auto& out) { k.blurDown(middles.data(), weights.data(), 4, n, out.data()); },
         n);
    same(
        [&](const scale::ScaleKernels& k, auto& out) {
          k.gradients(middles[0], middles[1], middles[2], n / 2, out.data(), out.data() + kMost);
        },
        n);
    std::vector<int> a(kMost), b(kMost);
    const int of_a = fastest.extrema(middles[0], middles[1], middles[2], 20, n, a.data()),
              of_b = baseline.extrema(middles[0], middles[1], middles[2], 20, n, b.data());
    EXPECT_EQ(of_a, of_b);
    EXPECT_EQ(a, b);
    EXPECT_TRUE(n < 64 || of_a > 5);
  }
}

}  // namespace
}  // namespace fathom::closure
