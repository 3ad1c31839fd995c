#include <gtest/gtest.h>

#include "realtime/base/units.hpp"
#include "realtime/onboard/localisation/keyframe_features.hpp"
#include "realtime/onboard/localisation/keyframe_selection.hpp"
#include "realtime/onboard/localisation/tried_pairs.hpp"
#include "tests/onboard/synthetic_survey.hpp"

namespace fathom::onboard {
namespace {

using testing::MemorySlots;

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
  closure::Feature feature{};
  feature.left = {1, 2};
  feature.right = {3, 4};
  feature.point = {0.1F, 0.2F, 2.0F + 0.01F * static_cast<float>(number)};
  feature.covariance = {1e-6F, 0, 0, 1e-6F, 0, 1e-5F};
  feature.size = 5;
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
  for (int k = 20; k < 21; ++k) store.add(featuresOf(k), {1.0 * k, 0, 0}, 0);
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
