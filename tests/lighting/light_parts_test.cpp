#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "recon/lighting/colour_light.hpp"
#include "recon/lighting/demosaic.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/range_lattice.hpp"

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
  neutraliseClipped({raw.data(), kSide, kSide, 2 * kSide, PixelFormat::kBayerRggb, 12}, 0.98, rgb.data());
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const std::uint8_t* pixel = &rgb[static_cast<std::size_t>(3 * (y * kSide + x))];
      const bool near = x >= 3 && x <= 6 && y >= 3 && y <= 6;
      EXPECT_EQ(pixel[1], near ? 120 : 90) << x << ' ' << y;
      EXPECT_EQ(pixel[0], 120);
    }
}

Camera wideCamera() {
  return {1360, 1024, 1711, 1712, 680, 512, 0.13, 0.7, 0.001, -0.001, 0};
}

TEST(RangeLattice, OfATiltedPlaneIsThePathAlongEachRay) {
  const Camera cam = wideCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.1, -0.15, 1).normalized();
  RangeLattice lattice;
  RangeMaker(cam).fromPlane(normal, 3.0, lattice);
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), {1359, 0}, {680, 512}, {300, 800}, {1100, 900}}) {
    const Eigen::Vector3d ray = cam.ray(pixel).normalized();
    EXPECT_NEAR(static_cast<double>(
                    lattice.at(static_cast<float>(pixel.x() / 1359), static_cast<float>(pixel.y() / 1023))),
                3.0 / normal.dot(ray), 0.005);
  }
}

TEST(RangeLattice, RaysThatMeetNoPlaneAreUnknown) {
  RangeLattice lattice;
  RangeMaker(wideCamera()).fromPlane(Eigen::Vector3d(1, 0, 0.1), 2.0, lattice);
  EXPECT_EQ(lattice.at(0.0F, 0.5F), 0.0F);
  EXPECT_GT(lattice.at(1.0F, 0.5F), 0.0F);
  RangeMaker(wideCamera())
      .fromPlane(Eigen::Vector3d::UnitZ(), std::numeric_limits<double>::quiet_NaN(), lattice);
  EXPECT_EQ(lattice.at(0.5F, 0.5F), 0.0F);
}

TEST(RangeLattice, BendsToPointsAndFillsHolesFromAround) {
  const Camera cam = wideCamera();
  const RangeMaker maker(cam);
  RangeLattice lattice, truth;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);  // by the altitude
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 2.0, truth);    // true
  std::mt19937 random(1);
  std::uniform_real_distribution<double> x(0, 1359), y(0, 1023);
  std::vector<Eigen::Vector3f> points;
  while (points.size() < 200) {
    const Eigen::Vector2d pixel(x(random), y(random));
    if (pixel.x() > 500 && pixel.x() < 900) continue;  // bare sand
    points.push_back((2.0 * cam.ray(pixel)).cast<float>());
  }
  points.emplace_back(0, 0, -1);
  points.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F, 2.0F);
  maker.bendTo(points, lattice);
  for (std::size_t k = 0; k < truth.path.size(); ++k) EXPECT_NEAR(lattice.path[k], truth.path[k], 0.02F) << k;
}

TEST(RangeLattice, FollowsALedge) {
  const Camera cam = wideCamera();
  const RangeMaker maker(cam);
  RangeLattice lattice;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);
  std::vector<Eigen::Vector3f> points;
  for (int y = 10; y < 1024; y += 40)
    for (int x = 10; x < 1360; x += 40)
      points.push_back(((x < 680 ? 2.0 : 6.0) * cam.ray(Eigen::Vector2d(x, y))).cast<float>());
  maker.bendTo(points, lattice);
  const auto depth = [&](double u) {
    const Eigen::Vector3d ray = cam.ray(Eigen::Vector2d(u * 1359, 512)).normalized();
    return static_cast<double>(lattice.at(static_cast<float>(u), 0.5F)) * ray.z();
  };
  EXPECT_NEAR(depth(0.25), 2.0, 0.05);
  EXPECT_NEAR(depth(0.40), 2.0, 0.10);
  EXPECT_NEAR(depth(0.60), 6.0, 0.30);
  EXPECT_NEAR(depth(0.75), 6.0, 0.15);
}

TEST(RangeLattice, WithoutPointsStaysThePlane) {
  const RangeMaker maker(wideCamera());
  RangeLattice lattice, before;
  maker.fromPlane(Eigen::Vector3d::UnitZ(), 3.0, lattice);
  before = lattice;
  maker.bendTo({}, lattice);
  EXPECT_EQ(lattice.path, before.path);
}

TEST(RigRanges, SeeOnePlaneFromBothCameras) {
  const Eigen::Vector3d right_in_left(0.07, 0.002, -0.003);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitY()));
  const StereoRig rig{wideCamera(), wideCamera(), SE3(turn, turn * -right_in_left)};
  RigRanges ranges(rig);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, 0.1, 1).normalized();
  ranges.fromPlane(normal, 2.5);
  // Along the right wideCamera's axis, from its centre to the plane.
  const SE3 T_left_right = rig.T_right_left.inverse();
  const Eigen::Vector3d ray = T_left_right.rotation() * rig.right.ray({679.5, 511.5}).normalized();
  const double expected = (2.5 - normal.dot(T_left_right.translation())) / normal.dot(ray);
  EXPECT_NEAR(static_cast<double>(ranges.right().at(0.5F, 0.5F)), expected, 0.003);
}

}  // namespace
}  // namespace fathom::lighting
