#include "recon/closure/candidates.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

namespace fathom::closure {
namespace {

TEST(OverlapProbability, AgreesWithCounting) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  struct Case {
    Eigen::Vector2d mean, sigma;
    double turn, reach;
  };
  for (const Case& c : {Case{{1, 0}, {0.5, 2}, 0.7, 1.2}, Case{{0, 0}, {3, 0.2}, 0.2, 0.8},
                        Case{{4, 3}, {2, 2}, 0, 1}, Case{{0.4, 0.3}, {0.01, 0.02}, 1, 0.6}}) {
    const Eigen::Matrix2d axes = Eigen::Rotation2Dd(c.turn).toRotationMatrix();
    const Eigen::Matrix2d covariance = axes * c.sigma.cwiseAbs2().asDiagonal() * axes.transpose();
    constexpr int kDraws = 200000;
    int inside = 0;
    for (int k = 0; k < kDraws; ++k) {
      const Eigen::Vector2d unit(normal(random), normal(random));
      inside += (c.mean + axes * c.sigma.cwiseProduct(unit)).norm() <= c.reach ? 1 : 0;
    }
    EXPECT_NEAR(overlapProbability(c.mean, covariance, c.reach), static_cast<double>(inside) / kDraws, 0.004);
  }
}

TEST(OverlapProbability, IsCertainWhereTheSeparationIs) {
  const Eigen::Matrix2d none = Eigen::Matrix2d::Zero();
  EXPECT_NEAR(overlapProbability({0.3, 0.4}, none, 0.6), 1.0, 1e-6);
  EXPECT_NEAR(overlapProbability({0.3, 0.4}, none, 0.4), 0.0, 1e-6);
  EXPECT_EQ(overlapProbability({0, 0}, none, 0), 0);
  EXPECT_EQ(overlapProbability({std::nan(""), 0}, Eigen::Matrix2d::Identity(), 1), 0);
}

TEST(Footprint, IsTheDiscOfTheImagesAreaWhereThePrincipalRayMeetsTheSeafloor) {
  Camera camera{680, 512, 860, 860, 340, 256};
  const SE3 tilted = SE3::fromEuler(0, 0.1, 0, {5, 7, 10});
  const Footprint f = footprintOf(tilted, rangeToLevelGround(tilted, 2.0), camera);
  EXPECT_NEAR(f.centre.x(), 5 + 2 * std::tan(0.1), 1e-9);
  EXPECT_NEAR(f.centre.y(), 7, 1e-9);
  const double range = 2 / std::cos(0.1);
  EXPECT_NEAR(f.radius, range * std::sqrt(680 * 512 / (M_PI * 860 * 860)), 1e-9);
}

TEST(Footprint, OfACameraThatLooksAheadIsWhereTheWallIs) {
  Camera camera{680, 512, 860, 860, 340, 256};
  for (const double tilt : {M_PI / 4, M_PI / 2}) {
    const Footprint f = footprintOf(SE3::fromEuler(0, tilt, 0, {5, 7, 10}), 3.0, camera);
    EXPECT_NEAR(f.centre.x(), 5 + 3 * std::sin(tilt), 1e-9);
    EXPECT_NEAR(f.radius, 3 * std::sqrt(680 * 512 / (M_PI * 860 * 860)), 1e-9);
  }
}

TEST(SeparationOfOverlap, SharesThatPartOfTheDisc) {
  EXPECT_NEAR(separationOfOverlap(0.391), 1.0, 0.001);  // two discs through each other's centre
  EXPECT_LT(separationOfOverlap(0.999), 0.01);
  EXPECT_GT(separationOfOverlap(0.001), 1.95);
}

// The integral by two million squares.
double byCounting(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double reach) {
  constexpr int kSide = 700;
  const Eigen::Matrix2d information = covariance.inverse();
  double sum = 0;
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      const Eigen::Vector2d d = reach * Eigen::Vector2d((2.0 * i + 1) / kSide - 1, (2.0 * j + 1) / kSide - 1);
      if (d.norm() > reach) continue;
      const Eigen::Vector2d e = d - mean;
      sum += std::exp(-0.5 * e.dot(information * e));
    }
  }
  return sum * std::pow(2 * reach / kSide, 2) / (2 * M_PI * std::sqrt(covariance.determinant()));
}

TEST(OverlapProbability, IsTheIntegralOverEveryShapeAndDistance) {
  double worst = 0;
  for (const double wide : {0.05, 0.3, 1.0, 4.0}) {
    for (const double narrow : {0.1, 0.4, 1.0}) {
      for (const double distance : {0.0, 0.5, 0.9, 1.0, 1.1, 2.0}) {
        for (const double turn : {0.0, 0.6, 1.2}) {
          const Eigen::Matrix2d axes = Eigen::Rotation2Dd(turn).toRotationMatrix();
          const Eigen::Vector2d sigma(wide, std::max(wide * narrow, 0.02));
          const Eigen::Matrix2d covariance = axes * sigma.cwiseAbs2().asDiagonal() * axes.transpose();
          worst = std::max(worst, std::abs(overlapProbability({distance, 0}, covariance, 1) -
                                           byCounting({distance, 0}, covariance, 1)));
        }
      }
    }
  }
  EXPECT_LT(worst, 0.01);
}

TEST(Candidate, OfDiscsThatMustOverlapIsWorthMoreTheLessCertainTheirSeparation) {
  const Footprint there{{0.1, 0}, 0.8}, here{{0, 0}, 0.8};
  const Candidate vague =
      candidateOf(0, there, 3, here, 0.25 * Eigen::Matrix2d::Identity(), {}, separationOfOverlap(0.3));
  const Candidate known =
      candidateOf(1, there, 3, here, 0.01 * Eigen::Matrix2d::Identity(), {}, separationOfOverlap(0.3));
  EXPECT_GT(known.probability, vague.probability);
  EXPECT_GT(vague.value(), known.value());
  EXPECT_EQ(vague.older, 0U);
  EXPECT_EQ(vague.newer, 3U);
}

TEST(CandidateQueue, DropsTheLeastValuableWhenFullAndCountsIt) {
  CandidateConfig config;
  config.capacity = 3;
  CandidateQueue queue(config);
  for (std::uint32_t k = 0; k < 5; ++k) queue.push({k, 10, 0.5, 1.0 + ((k * 2) % 5)});
  EXPECT_EQ(queue.size(), 3U);
  EXPECT_EQ(queue.dropped(), 2U);
  Candidate c;
  std::vector<double> information;
  while (queue.pop(c)) information.push_back(c.information);
  EXPECT_EQ(information, (std::vector<double>{5, 4, 3}));
}

}  // namespace
}  // namespace fathom::closure
