#include "recon/solver/batch/bundle_adjustment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace fathom::slam {
namespace {

// A rig 2 m above uneven ground, along a line and back beside it; every
// point is seen where it falls into both images.
struct SyntheticBundle {
  Bundle bundle;
  std::vector<SE3> truth;

  SyntheticBundle(double noise, double wrong, double false_share = 0) {
    Camera camera;
    camera.width = 1360;
    camera.height = 1024;
    camera.fx = camera.fy = 1770;
    camera.cx = 679.5;
    camera.cy = 511.5;
    camera.k1 = -0.1;
    bundle.rig = {camera, camera, SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0})};
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    constexpr int kFrames = 24;
    constexpr double kStep = 0.2, kBeside = 0.5;
    for (int k = 0; k < kFrames; ++k) {
      const bool back = k >= kFrames / 2;
      const double x = back ? (kFrames - 1 - k) * kStep : k * kStep;
      truth.push_back(SE3::fromEuler(0.02 * normal(random), 0.02 * normal(random), back ? M_PI : 0,
                                     {x, back ? kBeside : 0, 0.05 * normal(random)}));
      Vector6d off;
      for (int i = 0; i < 6; ++i) off(i) = wrong * normal(random);
      bundle.graph.poses.push_back(k == 0 ? truth[0] : truth[static_cast<std::size_t>(k)] * SE3::exp(off));
      bundle.graph.ids.push_back(k);
      bundle.nodes.push_back(k);
    }
    std::uniform_real_distribution<double> along(-0.8, 3), across(-0.6, 1.1), up(0, 0.3), share(0, 1);
    bundle.first = {0};
    for (int p = 0; p < 900; ++p) {
      const Eigen::Vector3d place(along(random), across(random), 2.1 - up(random));
      const std::size_t before = bundle.sightings.size();
      for (std::uint32_t k = 0; k < kFrames; ++k) {
        const Eigen::Vector3d here = truth[k].inverse() * place;
        const Eigen::Vector2d left = camera.project(here),
                              right = camera.project(bundle.rig.T_right_left * here);
        if (!camera.contains(left, 5) || !camera.contains(right, 5)) continue;
        Eigen::Vector2d n(noise * normal(random), noise * normal(random));
        if (share(random) < false_share) n += Eigen::Vector2d(4, -6);
        bundle.sightings.push_back({k, (left + n).cast<float>(), (right + n).cast<float>()});
      }
      if (bundle.sightings.size() < before + 2)
        bundle.sightings.resize(before);
      else
        bundle.first.push_back(static_cast<std::uint32_t>(bundle.sightings.size()));
    }
  }

  [[nodiscard]] double worst() const {
    double most = 0;
    for (std::size_t k = 0; k < truth.size(); ++k)
      most = std::max(most, (bundle.graph.poses[k].translation() - truth[k].translation()).norm());
    return most;
  }
};

TEST(BundleAdjustment, FindsThePosesOfPerfectSightings) {
  SyntheticBundle synthetic(0, 0.02);
  ASSERT_GT(synthetic.worst(), 0.02);
  const BundleResult result = adjust(synthetic.bundle, {});
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.place_before, 2.5);
  EXPECT_LT(result.place_after, 0.001);
  EXPECT_LT(synthetic.worst(), 2e-5) << "pixels are of 32 bits";
}

TEST(BundleAdjustment, FindsTheNoiseAndIsAsGoodAsIt) {
  SyntheticBundle synthetic(0.2, 0.02);
  const BundleResult result = adjust(synthetic.bundle, {});
  EXPECT_TRUE(result.converged);
  EXPECT_NEAR(result.place, 0.2, 0.04) << "of what a robust weight leaves";
  EXPECT_LT(synthetic.worst(), 0.003);
}

TEST(BundleAdjustment, FalseSightingsPullLittle) {
  SyntheticBundle clean(0.1, 0.01), soiled(0.1, 0.01, 0.05);
  (void)adjust(clean.bundle, {});
  (void)adjust(soiled.bundle, {});
  EXPECT_LT(soiled.worst(), 2 * clean.worst() + 0.0005);
}

TEST(BundleAdjustment, ScaleIsTheBaselinesAndEdgesCount) {
  SyntheticBundle synthetic(0.1, 0.01);
  // An edge that is surer than all points: the second frame half a metre on.
  RelativePose edge;
  edge.from = 0;
  edge.to = 1;
  edge.T_from_to = SE3(Eigen::Quaterniond::Identity(), {0.5, 0, 0});
  edge.information = 1e12 * Matrix6d::Identity();
  synthetic.bundle.graph.edges.push_back(edge);
  (void)adjust(synthetic.bundle, {});
  const SE3 step = synthetic.bundle.graph.poses[0].inverse() * synthetic.bundle.graph.poses[1];
  EXPECT_NEAR(step.translation().x(), 0.5, 0.001);
}

TEST(BundleAdjustment, NothingIsLeftAsItIs) {
  Bundle empty;
  EXPECT_EQ(adjust(empty, {}).points, 0U);
  SyntheticBundle synthetic(0, 0.02);
  synthetic.bundle.sightings.clear();
  synthetic.bundle.first = {0};
  const SE3 before = synthetic.bundle.graph.poses[3];
  EXPECT_EQ(adjust(synthetic.bundle, {}).points, 0U);
  EXPECT_EQ((before.inverse() * synthetic.bundle.graph.poses[3]).log().norm(), 0);
}

}  // namespace
}  // namespace fathom::slam
