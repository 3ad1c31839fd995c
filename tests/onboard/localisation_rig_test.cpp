// Localisation through a rig that is not what it was taken for.
#include <gtest/gtest.h>

#include <functional>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/online_closure_search.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/calibration/sensor_checks.hpp"
#include "tests/onboard/synthetic_survey.hpp"

namespace fathom::onboard {
namespace {

using testing::MemorySlots, testing::SyntheticSurvey, testing::syntheticSurvey;

// A feature's pixels through another rig, left camera frame [m].
Eigen::Vector3f triangulated(const StereoRig& rig, const closure::Feature& feature) {
  Eigen::Vector3d point;
  double gap = 0;
  EXPECT_TRUE(triangulatePixels(rig, feature.left.cast<double>(), feature.right.cast<double>(), point, gap));
  return point.cast<float>();
}

// A dive localised pair by pair, whose first pairs are seen through a rig that is wrong, until it is known.
class DiveThroughAWrongRig {
 public:
  // `correct` gives the core what it is to know of dive.rig before pair `known`.
  DiveThroughAWrongRig(SyntheticSurvey given, const StereoRig& wrong, std::size_t known,
                       const std::function<void(LocalisationCore&)>& correct,
                       const LocalisationConfig& config = testing::smallLocalisation())
      : dive(std::move(given)), rigs_(wrong), core_(rigs_, config, &slots_) {
    for (std::size_t k = 0; k < dive.frames.size(); ++k) {
      SyntheticSurvey::Frame& frame = dive.frames[k];
      if (k == known) {
        rigs_.add(dive.rig, true);
        correct(core_);
      }
      if (k < known)
        for (closure::Feature& f : frame.features.features) f.point = triangulated(wrong, f);
      keyframes_.push_back(frame.placeIn(core_));
    }
    core_.finish();
  }
  [[nodiscard]] SE3 poseOf(std::size_t k) const {
    return core_.poseOf(keyframes_[k], dive.frames[k].input.T_odom_cam);
  }

  SyntheticSurvey dive;

 private:
  calibration::RigHistory rigs_;
  MemorySlots slots_ = testing::featureSlots(300);
  LocalisationCore core_;
  std::vector<int> keyframes_;
};

// Lenses of which one is longer than calibrated turn every step of visual odometry to the same side.
TEST(LocalisationCore, StepsFromBeforeTheRigWasMeasuredAreEstimatedAgain) {
  constexpr std::size_t kMeasured = 12;
  SyntheticSurvey dive = syntheticSurvey();
  dive.frames.resize(4 * kMeasured);
  const StereoRig rig = dive.rig, wrong = calibration::changed(rig, {{0.002, 0, 0.002}, 0.003, 0});
  const DiveThroughAWrongRig localised(std::move(dive), wrong, kMeasured, [&](LocalisationCore& core) {
    core.setRig(rig, Eigen::Vector2d::Zero());
    core.resetRig(1e-4, 0, false);
  });
  const std::vector<SyntheticSurvey::Frame>& frames = localised.dive.frames;
  const SE3 seen = localised.poseOf(0).inverse() * localised.poseOf(kMeasured),
            truth = frames[0].truth.inverse() * frames[kMeasured].truth;
  EXPECT_LT(truth.rotation().angularDistance(seen.rotation()), 0.005);
}

// Focal lengths alike too long: every path was too short, until the DVL shows it.
TEST(LocalisationCore, StepsFromBeforeRangesWereCorrectedAreEstimatedAgain) {
  SyntheticSurvey dive = syntheticSurvey();
  const StereoRig rig = dive.rig, wrong = calibration::withoutRangeError(rig, {0.05, 0});
  const std::size_t known = dive.frames.size() / 2;
  const DiveThroughAWrongRig localised(std::move(dive), wrong, known, [&](LocalisationCore& core) {
    core.setRig(rig, {0.05, 0});
  });
  const std::vector<SyntheticSurvey::Frame>& frames = localised.dive.frames;
  const double length = (frames[10].truth.translation() - frames[0].truth.translation()).norm();
  EXPECT_NEAR((localised.poseOf(10).translation() - localised.poseOf(0).translation()).norm(), length,
              0.005 * length);
}

// One lens longer by 0.1 % than anybody knows: every step yaws to the same side, and closures show it.
TEST(LocalisationCore, AYawThatAllStepsShareIsTakenOutOfThemAll) {
  const auto turned = [](double spin) {
    SyntheticSurvey dive = syntheticSurvey();
    dive.fixes.clear();
    const StereoRig wrong = calibration::changed(dive.rig, {Eigen::Vector3d::Zero(), 1e-3, 0});
    const std::size_t never = dive.frames.size();
    LocalisationConfig config = testing::smallLocalisation();
    config.graph.rig.spin = spin;
    const DiveThroughAWrongRig localised(
        std::move(dive), wrong, never, [](LocalisationCore&) {}, config);
    const std::vector<SyntheticSurvey::Frame>& frames = localised.dive.frames;
    std::vector<double> off;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      const SE3 seen = localised.poseOf(0).inverse() * localised.poseOf(k),
                truth = frames[0].truth.inverse() * frames[k].truth;
      off.push_back(2 * std::abs((truth.rotation().conjugate() * seen.rotation()).z()));
    }
    return median(std::move(off));
  };
  const double with = turned(slam::RigPrior().spin), without = turned(0);
  EXPECT_LT(with, 0.4 * without);
}

const calibration::RigHistory kRigs{StereoRig{}};  // never known better

bool takeAt(KeyframeSelection& selection, double north, std::int64_t utc_ns, double yaw = 0) {
  const SE3 pose = SE3::fromEuler(0, 0, yaw, {north, 0, 10});
  return selection.take(utc_ns, pose, {{north, 0}, 0.8});
}

TEST(KeyframeSelection, TakesTheFirstThenThoseThatShareTooLittleTurnedOrComeLate) {
  KeyframeSelection selection(LocalisationConfig{});
  EXPECT_TRUE(takeAt(selection, 0, kSecond_ns));
  EXPECT_FALSE(takeAt(selection, 0.1, kSecond_ns + 1));
  // Discs of 0.8 m that share 70 % of their area are 0.48 of their radius apart.
  EXPECT_FALSE(takeAt(selection, 0.37, kSecond_ns + 2));
  const SE3 near(Eigen::Quaterniond::Identity(), {0.37, 0, 0});
  EXPECT_FALSE(selection.due(kSecond_ns + 2, near, {{0.37, 0}, 0.8}, true));
  EXPECT_TRUE(selection.due(kSecond_ns + 2, near, {{0.37, 0}, 0.8}, true, {0.03, 0})) << "if it is corrected";
  EXPECT_TRUE(takeAt(selection, 0.40, kSecond_ns + 3));
  EXPECT_FALSE(takeAt(selection, 0.40, kSecond_ns + 4, 0.3));
  EXPECT_TRUE(takeAt(selection, 0.40, kSecond_ns + 5, 0.4));
  EXPECT_FALSE(takeAt(selection, 0.40, 4 * kSecond_ns, 0.4));
  EXPECT_TRUE(takeAt(selection, 0.40, 6 * kSecond_ns, 0.4));
}

TEST(KeyframeSelection, TakesEveryFrameWhileOdometryIsUnreliable) {
  KeyframeSelection selection(LocalisationConfig{});
  const SE3 pose = SE3::fromEuler(0, 0, 0, {0, 0, 10});
  const closure::Footprint seen{{0, 0}, 0.8};
  EXPECT_TRUE(selection.take(kSecond_ns, pose, seen));
  EXPECT_FALSE(selection.take(kSecond_ns + 1, pose, seen));
  for (int i = 2; i < 100; ++i) EXPECT_TRUE(selection.take(kSecond_ns + i, pose, seen, false));
}

closure::FrameFeatures featuresOf(int number) {
  closure::FrameFeatures f;
  closure::Feature feature{.left = {1, 2},
                           .right = {3, 4},
                           .point = {0.1F, 0.2F, 2.0F + 0.01F * static_cast<float>(number)},
                           .covariance = {1e-6F, 0, 0, 1e-6F, 0, 1e-5F},
                           .size = 5};
  f.features.assign(20, feature);
  f.descriptors.assign(20 * 128, static_cast<std::uint8_t>(number));
  return f;
}

MemorySlots slotsFor(std::size_t slots) {
  return {slots, closure::slotBytes(20)};
}

TEST(KeyframeFeatures, OldOnesComeBackFromTheirSlotsAsTheyWere) {
  MemorySlots slots = slotsFor(100);
  KeyframeFeatures store(&slots, 100, 20, kRigs);
  for (int k = 0; k < 60; ++k) store.add(featuresOf(k), {0.5 * k, 0, 0}, 0);
  for (const int k : {0, 30, 59}) {
    const auto* found = store.find(k);
    ASSERT_NE(found, nullptr) << k;
    EXPECT_EQ(found->descriptors, featuresOf(k).descriptors);
    EXPECT_EQ(found->features[3].point, featuresOf(k).features[3].point);
  }
  EXPECT_EQ(store.find(60), nullptr);
  EXPECT_EQ(store.find(-1), nullptr);
  EXPECT_EQ(store.counters().evicted, 0u);
}

TEST(KeyframeFeatures, PointsAreThoseOfThePresentRig) {
  StereoRig nominal;
  nominal.left = nominal.right = {680, 512, 900, 900, 340, 256};
  nominal.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  StereoRig found = nominal;
  found.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.077, 0, 0});
  calibration::RigHistory rigs(nominal);
  MemorySlots slots = slotsFor(100);
  KeyframeFeatures store(&slots, 100, 20, rigs);
  closure::FrameFeatures features = featuresOf(1);
  for (closure::Feature& f : features.features) f.left = {400, 300}, f.right = {368.5, 300}, f.point.z() = 2;
  for (int k = 0; k < 40; ++k) store.add(features, {0.5 * k, 0, 0}, 0);
  EXPECT_EQ(store.find(2)->features[0].point.z(), 2);
  rigs.add(found, true);
  for (const int k : {2, 39}) {  // from its slot, and from memory
    EXPECT_NEAR(store.find(k)->features[0].point.z(), 2.2, 1e-5) << k;
    EXPECT_NEAR(store.find(k)->features[0].covariance[5], 1e-5 * std::pow(1.1, 4), 1e-8) << k;
  }
  rigs.add(nominal, false);  // knocked: then it stood as it was found
  EXPECT_NEAR(store.find(2)->features[0].point.z(), 2.2, 1e-5);
}

TEST(KeyframeFeatures, TwoThatWereFoundOneAfterTheOtherStayBoth) {
  MemorySlots slots = slotsFor(100);
  KeyframeFeatures store(&slots, 100, 20, kRigs);
  for (int k = 0; k < 60; ++k) store.add(featuresOf(k), {0.5 * k, 0, 0}, 0);
  for (int step = 0; step < 500; ++step) {
    const int a = (step * 7) % 11, b = 11 + (step * 5) % 13;
    const auto *first = store.find(a), *second = store.find(b);
    ASSERT_EQ(first->descriptors[0], a);
    ASSERT_EQ(second->descriptors[0], b);
  }
}

TEST(KeyframeFeatures, WithoutFreeSlotsTheKeyframeAmongTheClosestNeighboursIsEvicted) {
  MemorySlots slots = slotsFor(20);
  KeyframeFeatures store(&slots, 100, 20, kRigs);
  for (int k = 0; k < 20; ++k) store.add(featuresOf(k), {k == 8 ? 7.6 : k == 9 ? 8.0 : 1.0 * k, 0, 0}, 0);
  store.add(featuresOf(20), {20, 0, 0}, 0);
  EXPECT_EQ(store.counters().evicted, 1u);
  for (int k = 21; k < 40; ++k) store.add(featuresOf(k), {1.0 * k, 0, 0}, 0);
  // Number 8 lay between neighbours 1 m apart, the others 2 m.
  EXPECT_EQ(store.find(8), nullptr);
  EXPECT_EQ(store.counters().evicted, 20u);
  int left = 0;
  for (int k = 0; k < 40; ++k) left += store.find(k) != nullptr;
  EXPECT_GE(left, 20);
}

TEST(KeyframeFeatures, AKeyframeThatRetiresLeavesItsSlotToAnother) {
  MemorySlots slots = slotsFor(24);
  KeyframeFeatures store(&slots, 24, 20, kRigs);
  for (int k = 0; k < 500; ++k) {
    if (store.keyframes().size() == 24) store.retire(k % 7 == 0 ? store.keyframes()[0] : k - 20);
    store.add(featuresOf(k), {0.5 * k, 0, 0}, 0);
  }
  EXPECT_EQ(store.counters().evicted, 0u);
  EXPECT_EQ(store.counters().stored, 500u);
  EXPECT_FALSE(store.has(0));
  EXPECT_EQ(store.find(0), nullptr);
  for (const int k : store.keyframes()) {
    ASSERT_TRUE(store.has(k));
    EXPECT_EQ(store.find(k)->descriptors, featuresOf(k).descriptors);
  }
}

TEST(KeyframeFeatures, ABadDiskIsCountedAndTheNewestStayInMemory) {
  MemorySlots slots = slotsFor(100);
  KeyframeFeatures store(&slots, 100, 20, kRigs);
  for (int k = 0; k < 30; ++k) store.add(featuresOf(k), {0.5 * k, 0, 0}, 0);
  slots.fails = true;
  EXPECT_EQ(store.find(2), nullptr);
  EXPECT_EQ(store.counters().read_failures, 1u);
  store.add(featuresOf(30), {15, 0, 0}, 0);
  EXPECT_EQ(store.counters().write_failures, 1u);
  EXPECT_NE(store.find(30), nullptr);
}

TEST(TriedPairs, RemembersPairsAndForgetsAllRatherThanGrow) {
  TriedPairs tried(100);
  const std::size_t bytes = tried.memoryBytes();
  EXPECT_FALSE(tried.contains(3, 4));
  tried.insert(0, 0);
  tried.insert(3, 4);
  EXPECT_TRUE(tried.contains(0, 0));
  EXPECT_TRUE(tried.contains(3, 4));
  EXPECT_FALSE(tried.contains(4, 3));
  for (int k = 0; k < 1000; ++k) tried.insert(k, k + 5);
  EXPECT_EQ(tried.memoryBytes(), bytes);
  EXPECT_TRUE(tried.contains(999, 1004));
}

TEST(TriedPairs, APairMayBeTriedAgainWhenItsSeparationHasChanged) {
  TriedPairs tried(100);
  tried.insert(3, 4, {2.0, 1.0}, 0.5);
  EXPECT_TRUE(tried.contains(3, 4, {2.3, 1.3}));
  EXPECT_FALSE(tried.contains(3, 4, {2.5, 1.3}));
  tried.insert(3, 4, {2.5, 1.3}, 0.2);
  EXPECT_TRUE(tried.contains(3, 4, {2.5, 1.3}));
  EXPECT_FALSE(tried.contains(3, 4, {2.0, 1.0}));
}

}  // namespace
}  // namespace fathom::onboard
