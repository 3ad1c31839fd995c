#include "recon/lighting/colour_light.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "recon/lighting/lighting_model.hpp"

namespace fathom::lighting {
namespace {

Camera smallCamera() {
  return {340, 256, 428, 428, 170, 128, 0, 0, 0, 0, 0};
}

TEST(RangeLattice, KnowsTheGroundsNormalsAndPlaces) {
  const Camera cam = smallCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.3, -0.2, 1).normalized();
  RangeLattice lattice;
  RangeMaker(cam).fromPlane(normal, 2.0, lattice);
  for (const float u : {0.0F, 0.31F, 0.77F, 1.0F})
    for (const float v : {0.0F, 0.5F, 0.93F}) {
      const RangeLattice::Ground ground = lattice.groundAt(u, v);
      EXPECT_LT((ground.normal.cast<double>() + normal).norm(), 1e-3);
      EXPECT_NEAR(normal.dot(ground.point.cast<double>()), 2.0, 1e-3);
    }
}

// Patches of unknown albedo at all tilts, in the light of one Lambertian lamp beside the smallCamera.
TEST(TiltResponse, LearnsWhereTheLampIsAndTakesTheShadingOut) {
  const Eigen::Vector3f lamp(0.5F, -0.3F, 0);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> place(-0.8F, 0.8F), depth(1.5F, 2.5F);
  std::normal_distribution<float> slope(0, 0.25F), albedo(1, 0.3F);
  TiltResponse tilt;
  const auto draw = [&] {
    const float z = depth(random);
    return RangeLattice::Ground{{place(random), place(random), z},
                                Eigen::Vector3f(slope(random), slope(random), -1).normalized()};
  };
  const auto truth = [&](const RangeLattice::Ground& g) {
    return std::max(0.0F, g.normal.dot(lamp - g.point)) / g.point.z();
  };
  for (int k = 0; k < 40000; ++k) {
    const RangeLattice::Ground ground = draw();
    tilt.add(ground, std::max(albedo(random), 0.1F) * truth(ground));
  }
  tilt.solve();
  RecordProperty("strength", std::to_string(tilt.strength()));
  std::printf("strength %.3f, lamp %.3f %.3f m\n", tilt.strength(), tilt.lamp().x(), tilt.lamp().y());
  EXPECT_NEAR(tilt.strength(), 1, 0.1);
  EXPECT_LT((tilt.lamp() - lamp.head<2>()).norm(), 0.08);
  double before = 0, after = 0;
  for (int k = 0; k < 2000; ++k) {
    const RangeLattice::Ground ground = draw();
    if (truth(ground) < TiltResponse::kDarkest || truth(ground) > TiltResponse::kBrightest) continue;
    before += std::abs(truth(ground) - 1);
    after += std::abs(truth(ground) / tilt.at(ground) - 1);
  }
  EXPECT_LT(after, 0.2 * before);
}

TEST(TiltResponse, StartsFromALampAtTheCamera) {
  TiltResponse tilt;
  tilt.solve();
  EXPECT_FLOAT_EQ(tilt.strength(), 1);
  const RangeLattice::Ground square{{0, 0, 2}, {0, 0, -1}};
  EXPECT_FLOAT_EQ(tilt.at(square), 1);
  const float tilted = 0.5F;  // [rad]
  EXPECT_NEAR(tilt.at({{0, 0, 2}, {std::sin(tilted), 0, -std::cos(tilted)}}), std::cos(tilted), 1e-5);
}

// A black level of 0.012: dim ground keeps less of its contrast.
TEST(Pedestal, IsFoundFromTheLossOfContrastInTheDark) {
  constexpr float kBlack = 0.012F;
  std::mt19937 random(5);
  std::normal_distribution<float> albedo(1, 0.25F);
  for (const float black : {kBlack, 0.0F}) {
    Pedestal pedestal;
    for (int k = 0; k < 30000; ++k) {
      const float light = 0.02F * std::exp2(static_cast<float>(k % 5)), expected = light + black;
      pedestal.add(expected, (light * std::max(albedo(random), 0.0F) + black) / expected);
    }
    pedestal.solve();
    EXPECT_NEAR(pedestal.level(), black, 0.002F);
  }
  Pedestal nothing;
  nothing.solve();
  EXPECT_EQ(nothing.level(), 0);
}

// White beyond the sensor's full scale: green clips first, which would make it pink.
TEST(Clipped, PixelsAreGreyAndTheirNeighboursKeepTheirColour) {
  constexpr int kSide = 16;
  std::vector<std::uint16_t> raw(kSide * kSide, 1000);
  std::vector<std::uint8_t> rgb(3 * kSide * kSide);
  for (std::size_t k = 0; k < rgb.size(); ++k) rgb[k] = static_cast<std::uint8_t>(k % 3 == 1 ? 90 : 120);
  raw[5 * kSide + 4] = 4095;  // green, in the cell of columns 4 and 5, rows 4 and 5
  greyWhereClipped({raw.data(), kSide, kSide, 2 * kSide, PixelFormat::kBayerRggb, 12}, 0.98, rgb.data());
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const std::uint8_t* pixel = &rgb[static_cast<std::size_t>(3 * (y * kSide + x))];
      const bool near = x >= 3 && x <= 6 && y >= 3 && y <= 6;
      EXPECT_EQ(pixel[1], near ? 120 : 90) << x << ' ' << y;
      EXPECT_EQ(pixel[0], 120);
    }
}

}  // namespace
}  // namespace fathom::lighting
