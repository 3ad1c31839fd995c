#include "recon/topside/plan/image_gains.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fathom::topside {
namespace {

// A floor of `count` vertices whose colours are those of an image `gain` times as bright.
Mesh floorOf(int count, double gain) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> place(0, 1);
  std::uniform_int_distribution<int> grey(60, 140);
  Mesh mesh;
  for (int k = 0; k < count; ++k) {
    mesh.vertices.push_back({place(random), place(random), 2});
    const double srgb = grey(random) / 255.0;
    const auto level = static_cast<std::uint8_t>(std::lround(255 * srgb * std::pow(gain, 1 / 2.2)));
    mesh.colours.push_back({level, level, level});
  }
  return mesh;
}

TEST(ImageGains, VerticesAtTheSamePlaceTellWhichImageIsBrighter) {
  const Mesh one = floorOf(200, 1), brighter = floorOf(200, 1.4);
  EXPECT_NEAR(logBrightness(brighter, one).value(), std::log(1.4), 0.03);
  EXPECT_NEAR(logBrightness(one, brighter).value(), -std::log(1.4), 0.03);
  EXPECT_FALSE(logBrightness(floorOf(5, 1), one).has_value());
  Mesh elsewhere = one;
  for (auto& v : elsewhere.vertices) v.x() += 5;
  EXPECT_FALSE(logBrightness(elsewhere, one).has_value());
}

std::vector<Couple> chainOf(const std::vector<double>& gains, double noise) {
  std::mt19937 random(7);
  std::normal_distribution<double> error(0, noise);
  std::vector<Couple> out;
  for (std::uint32_t k = 0; k + 1 < gains.size(); ++k)
    out.push_back({k, k + 1, std::log(gains[k] / gains[k + 1]) + error(random)});
  return out;
}

TEST(ImageGains, ThatJumpAreFoundAndThoseThatDoNotStayOne) {
  std::mt19937 random(3);
  std::normal_distribution<double> jump(0, 0.25);
  std::vector<double> gains(60);
  for (double& g : gains) g = std::exp(jump(random));
  const std::vector<float> found = gainsOf(gains.size(), chainOf(gains, 0.01));
  double before = 0, after = 0;
  for (std::size_t k = 1; k < gains.size(); ++k) {
    before += std::abs(std::log(gains[k] / gains[k - 1]));
    after +=
        std::abs(std::log(gains[k] / gains[k - 1]) - std::log(static_cast<double>(found[k] / found[k - 1])));
  }
  EXPECT_LT(after, 0.1 * before);
  for (const float g : gainsOf(60, chainOf(std::vector<double>(60, 1.0), 0.015))) EXPECT_NEAR(g, 1, 0.005F);
  EXPECT_EQ(gainsOf(3, {{0, 1, {}}, {1, 2, {}}}), std::vector<float>(3, 1.0F));
}

}  // namespace
}  // namespace fathom::topside
