#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <vector>

#include "recon/closure/candidates.hpp"

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
  CandidateQueue queue({.capacity = 3});
  for (std::uint32_t k = 0; k < 5; ++k) queue.push({k, 10, 0.5, 1.0 + ((k * 2) % 5)});
  EXPECT_EQ(queue.size(), 3U);
  EXPECT_EQ(queue.dropped(), 2U);
  Candidate c;
  std::vector<double> information;
  while (queue.pop(c)) information.push_back(c.information);
  EXPECT_EQ(information, (std::vector<double>{5, 4, 3}));
}

constexpr double kRadius = 0.8, kStep = 0.25, kOverlap = 0.3;  // [m], [m], share

// Lines of `frames` frames there and back, `spacing` apart.
std::vector<Footprint> lawnMower(int lines, int frames, double spacing) {
  std::vector<Footprint> footprints;
  for (int line = 0; line < lines; ++line)
    for (int k = 0; k < frames; ++k)
      footprints.push_back({{kStep * (line % 2 == 0 ? k : frames - 1 - k), spacing * line}, kRadius});
  return footprints;
}

// Dead reckoning that drifts along and across by these shares of the path.
Separation drifting(double along, double across) {
  return [=](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
    const double path = kStep * static_cast<double>(b - a);
    return Eigen::Vector2d(std::pow(along * path, 2), std::pow(across * path, 2)).asDiagonal();
  };
}

TEST(Stretches, AreOfEightFramesOrThreeMetresAndCoverAllFrames) {
  const std::vector<Footprint> footprints = lawnMower(1, 100, 1);
  const std::vector<Stretch> stretches = stretchesOf(footprints, drifting(0.01, 0.01));
  EXPECT_EQ(stretches.size(), 13U);
  std::uint32_t next = 0;
  for (const Stretch& s : stretches) {
    EXPECT_EQ(s.first, next);
    EXPECT_LT(s.middle(), s.end);
    next = s.end;
  }
  EXPECT_EQ(next, 100U);
  EXPECT_TRUE(stretchesOf({}, drifting(0, 0)).empty());
}

TEST(Stretches, AreSingleFramesWhereThePathBetweenIsUncertain) {
  const std::vector<Footprint> footprints = lawnMower(1, 64, 1);
  const auto lost = [](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
    return (a < 30 && b >= 30 ? 4.0 : 1e-6) * Eigen::Matrix2d::Identity();
  };
  const std::vector<Stretch> stretches = stretchesOf(footprints, lost);
  EXPECT_EQ(stretches.size(), 6U + 16U);
}

TEST(StretchTree, FindsAllThatMayOverlapWithinThreeSigmaInEitherDirectionAndSkipsTheRest) {
  const std::vector<Footprint> footprints = lawnMower(30, 80, 1.0);
  const Separation separation = drifting(0.0005, 0.004);
  const StretchTree tree(footprints, stretchesOf(footprints, separation), kOverlap, separation);
  const std::vector<Stretch>& stretches = tree.stretches();
  int calls = 0;
  const Separation counted = [&](std::uint32_t a, std::uint32_t b) {
    ++calls;
    return separation(a, b);
  };
  const double reach = separationOfOverlap(kOverlap) * kRadius;
  std::size_t found_in_all = 0, wanted = 0;
  std::vector<StretchTree::Near> near;
  for (std::uint32_t s = 0; s < stretches.size(); ++s) {
    tree.near(s, counted, near);
    found_in_all += near.size();
    std::set<std::uint32_t> found;
    for (const StretchTree::Near& n : near) {
      found.insert(n.stretch);
      EXPECT_LT((n.covariance - separation(stretches[n.stretch].middle(), stretches[s].middle())).norm(),
                1e-12);
    }
    for (std::uint32_t other = 0; other < s; ++other) {
      const std::uint32_t a = stretches[other].middle(), b = stretches[s].middle();
      const Eigen::Vector2d apart = footprints[b].centre - footprints[a].centre;
      const Eigen::Matrix2d covariance = separation(a, b);
      if (apart.norm() > reach + 3 * std::sqrt(apart.normalized().dot(covariance * apart.normalized())))
        continue;
      ++wanted;
      EXPECT_TRUE(found.contains(other)) << other << " from " << s;
    }
  }
  const std::size_t all = stretches.size() * (stretches.size() - 1) / 2;
  EXPECT_LT(calls, static_cast<int>(all) / 2);
  EXPECT_LT(found_in_all, 6 * wanted);
}

TEST(StretchTree, ATrackOutAndBackWithoutFixesIsSearchedFromEndToEnd) {
  // 500 m out and back; in the end dead reckoning is off by 10 m across and 2 m along.
  const std::vector<Footprint> footprints = lawnMower(2, 2000, 0);
  const Separation separation = drifting(0.002, 0.01);
  const StretchTree tree(footprints, stretchesOf(footprints, separation), kOverlap, separation);
  const std::vector<Stretch>& stretches = tree.stretches();
  std::vector<StretchTree::Near> near;
  for (std::uint32_t s = static_cast<std::uint32_t>(stretches.size()) / 2 + 2; s < stretches.size(); ++s) {
    tree.near(s, separation, near);
    double best = 0;
    const std::uint32_t newer = stretches[s].middle();
    for (const StretchTree::Near& n : near) {
      const std::uint32_t older = stretches[n.stretch].middle();
      best = std::max(best, candidateOf(older, footprints[older], newer, footprints[newer], n.covariance, {},
                                        separationOfOverlap(kOverlap))
                                .value());
    }
    EXPECT_GT(best, 0.1) << "stretch " << s;
  }
}

TEST(StretchTree, TestsAsManyPlacesAFrameInALongDiveAsInAShortOne) {
  const auto callsAFrame = [](int lines) {
    const std::vector<Footprint> footprints = lawnMower(lines, 200, 1.0);
    // As well known anywhere as fixes make it.
    const Separation separation = [](std::uint32_t a, std::uint32_t b) -> Eigen::Matrix2d {
      return std::min(0.01, std::pow(0.002 * kStep * static_cast<double>(b - a), 2)) *
             Eigen::Matrix2d::Identity();
    };
    const StretchTree tree(footprints, stretchesOf(footprints, separation), kOverlap, separation);
    int calls = 0;
    const Separation counted = [&](std::uint32_t a, std::uint32_t b) {
      ++calls;
      return separation(a, b);
    };
    std::vector<StretchTree::Near> near;
    for (std::uint32_t s = 0; s < tree.stretches().size(); ++s) tree.near(s, counted, near);
    return static_cast<double>(calls) / static_cast<double>(footprints.size());
  };
  EXPECT_LT(callsAFrame(80), 1.5 * callsAFrame(20));
}

}  // namespace
}  // namespace fathom::closure
