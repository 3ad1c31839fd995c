#include "recon/closure/stretches.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

namespace fathom::closure {
namespace {

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
