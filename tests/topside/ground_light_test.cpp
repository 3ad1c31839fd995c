#include "recon/topside/plan/ground_light.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "recon/geometry/colour.hpp"
#include "tests/world/light_dives.hpp"

namespace fathom::topside {
namespace {

// A floor of `count` vertices 2 m below a camera that looks down, with the colours of an image `gain` times
// as bright.
Mesh floorOf(int count, double gain) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> place(0, 1);
  std::uniform_int_distribution<int> grey(60, 140);
  Mesh mesh;
  for (int k = 0; k < count; ++k) {
    mesh.vertices.push_back({place(random), place(random), 2});
    mesh.normals.emplace_back(0, 0, -1);
    const double srgb = grey(random) / 255.0;
    const auto level = static_cast<std::uint8_t>(std::lround(255 * srgb * std::pow(gain, 1 / 2.2)));
    mesh.colours.push_back({level, level, level});
  }
  return mesh;
}

double middleRatio(const Mesh& a, const Mesh& b) {
  double sum = 0;
  const std::vector<SamePlace> places = samePlaces(a, b, SE3(), SE3());
  for (const SamePlace& place : places) sum += static_cast<double>(place.log_ratio.y());
  return sum / static_cast<double>(places.size());
}

TEST(GroundLight, VerticesAtTheSamePlaceTellWhichImageIsBrighter) {
  const Mesh one = floorOf(200, 1), brighter = floorOf(200, 1.4);
  EXPECT_NEAR(middleRatio(brighter, one), std::log(1.4), 0.03);
  EXPECT_NEAR(middleRatio(one, brighter), -std::log(1.4), 0.03);
  const std::vector<SamePlace> places = samePlaces(one, brighter, SE3(), SE3());
  ASSERT_FALSE(places.empty());
  EXPECT_FLOAT_EQ(places[0].depth[0], 2);
  EXPECT_GT(places[0].range[1], 2);
  EXPECT_TRUE(samePlaces(floorOf(5, 1), one, SE3(), SE3()).empty());
  Mesh elsewhere = one, steep = one;
  for (auto& v : elsewhere.vertices) v.x() += 5;
  EXPECT_TRUE(samePlaces(elsewhere, one, SE3(), SE3()).empty());
  for (auto& n : steep.normals) n = Eigen::Vector3f(0, 0.8F, -0.6F);
  EXPECT_TRUE(samePlaces(steep, one, SE3(), SE3()).empty());
}

std::vector<Couple> chainOf(const std::vector<double>& gains, double noise) {
  std::mt19937 random(7);
  std::normal_distribution<double> error(0, noise);
  std::vector<Couple> out;
  for (std::uint32_t k = 0; k + 1 < gains.size(); ++k) {
    const auto ratio = static_cast<float>(std::log(gains[k] / gains[k + 1]) + error(random));
    out.push_back({k, k + 1, {{{2, 2}, {2, 2}, Eigen::Vector3f::Constant(ratio)}}});
  }
  return out;
}

TEST(GroundLight, GainsThatJumpAreFoundAndThoseThatDoNotStayOne) {
  std::mt19937 random(3);
  std::normal_distribution<double> jump(0, 0.25);
  std::vector<double> gains(60);
  for (double& g : gains) g = std::exp(jump(random));
  const std::vector<float> found = gainsOf(gains.size(), chainOf(gains, 0.01), {});
  double before = 0, after = 0;
  for (std::size_t k = 1; k < gains.size(); ++k) {
    before += std::abs(std::log(gains[k] / gains[k - 1]));
    after +=
        std::abs(std::log(gains[k] / gains[k - 1]) - std::log(static_cast<double>(found[k] / found[k - 1])));
  }
  EXPECT_LT(after, 0.1 * before);
  for (const float g : gainsOf(60, chainOf(std::vector<double>(60, 1.0), 0.015), {}))
    EXPECT_NEAR(g, 1, 0.005F);
  EXPECT_EQ(gainsOf(3, {}, {}), std::vector<float>(3, 1.0F));
}

// Sand at 4 m and a reef at 2 m, a quarter as bright: the model takes the difference for light.
void learnReefAndSand(lighting::LightingModel& model) {
  using Floor = test::SyntheticRangeDive;
  constexpr double kReef = 0.25;
  Floor scene(3);
  for (int k = 0; k < 120; ++k) {
    const bool reef = k % 2 == 0;
    const double altitude = (reef ? 2.0 : 4.0) + 0.1 * (k % 7);
    std::vector<std::uint16_t> picture = scene.textured(altitude);
    if (reef)
      for (std::uint16_t& level : picture) level = static_cast<std::uint16_t>(kReef * level);
    model.add(Floor::view(picture), Floor::ranges(altitude));
  }
}

TEST(GroundLight, TheSameGroundFromTwoRangesTellsDarkGroundFromLightThatFell) {
  lighting::LightingModel model(test::kRangeWidth, test::kRangeHeight, PixelFormat::kMono, 12, {.grid = 8});
  learnReefAndSand(model);
  ASSERT_EQ(model.used(), lighting::LightingKind::kRangeDependent);
  const lighting::Attenuation truth{-1.9, 0.45};
  const auto off = [&](double range) { return truth.logAt(range) - model.logFall(1, range); };
  const double hidden = off(4) - off(2);
  EXPECT_GT(std::abs(hidden), 0.8) << "what the model took for light";
  std::mt19937 random(5);
  std::normal_distribution<double> error(0, 0.02);
  std::uniform_real_distribution<double> low(1.9, 3.9), higher(0.1, 0.6);
  std::vector<Couple> couples;
  for (std::uint32_t k = 0; k < 80; ++k) {
    const double a = low(random), b = a + higher(random);
    const auto ratio = static_cast<float>(off(a) - off(b) + error(random));
    const auto one = static_cast<float>(a), other = static_cast<float>(b);
    const SamePlace place{{one, other}, {one, other}, Eigen::Vector3f::Constant(ratio)};
    couples.push_back({k, k + 1, std::vector<SamePlace>(30, place)});
  }
  const auto water = waterOf(couples, model);
  ASSERT_TRUE(water.has_value());
  const lighting::FallCorrection fall = model.correctionTo(*water);
  EXPECT_NEAR(static_cast<double>(fall.at(1, 4, 4) - fall.at(1, 2, 2)), hidden, 0.05);
  EXPECT_FALSE(waterOf({}, model).has_value()) << "nothing to learn from";
  const auto usual = static_cast<float>(model.usualRange());
  EXPECT_NEAR(fall.at(1, 1.2F * usual, usual), fall.at(1, usual, usual), 1e-5)
      << "the pattern holds the fall towards the image's edge";

  Mesh mesh;
  mesh.vertices = {{0, 0, 2}, {0, 0, 4}};
  mesh.colours = {{120, 120, 120}, {120, 120, 120}};
  relight(mesh, 1, fall);
  const double ratio = luminanceOf(mesh.colours[1]) / luminanceOf(mesh.colours[0]);
  double expected = 0;
  for (std::size_t c = 0; c < 3; ++c)
    expected -= static_cast<double>(fall.at(c, 4, 4) - fall.at(c, 2, 2)) / 3;
  EXPECT_NEAR(std::log(ratio), expected, 0.1) << "levels of 8 bits";
}

}  // namespace
}  // namespace fathom::topside
