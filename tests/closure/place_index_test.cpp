#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "realtime/base/bytes/state_archive.hpp"
#include "recon/closure/place_index.hpp"
#include "tests/world/pictures.hpp"

namespace fathom::closure {
namespace {

using Descriptor = std::array<std::uint8_t, 128>;
using test::lookingDown;

// Ground as a row of objects, each with a descriptor; a frame shows some consecutive ones, with noise.
class Ground {
 public:
  explicit Ground(int objects) : descriptors_(static_cast<std::size_t>(objects)) {
    std::exponential_distribution<double> histogram(1.0);
    for (Descriptor& d : descriptors_) {
      std::array<double, 128> h{};
      double sum = 0;
      for (double& v : h) sum += v = histogram(random_);
      for (std::size_t k = 0; k < h.size(); ++k)
        d[k] = static_cast<std::uint8_t>(std::min(255.0, 512 * std::sqrt(h[k] / sum)));
    }
  }
  FrameFeatures frame(int first, int count) {
    constexpr double kChange = 5;
    std::normal_distribution<double> change(0, kChange);
    FrameFeatures frame;
    frame.features.assign(static_cast<std::size_t>(count),
                          Feature{{0, 0}, {0, 0}, {0, 0, 0}, {0, 0, 0, 0, 0, 0}, 0});
    for (int k = first; k < first + count; ++k)
      for (const std::uint8_t v : descriptors_[static_cast<std::size_t>(k)])
        frame.descriptors.push_back(static_cast<std::uint8_t>(std::clamp(v + change(random_), 0.0, 255.0)));
    return frame;
  }

 private:
  std::mt19937 random_{7};
  std::vector<Descriptor> descriptors_;
};

PlaceIndexConfig small(int places) {
  return PlaceIndexConfig{.max_places = places, .features = 60};
}

std::vector<int> idsOf(std::span<const PlaceIndex::Place> places) {
  std::vector<int> ids;
  for (const auto& p : places) ids.push_back(p.id);
  return ids;
}

const auto kAny = [](int) { return true; };

TEST(PlaceIndex, FindsTheFramesThatShareMostOfTheGroundFirst) {
  Ground ground(6000);
  PlaceIndex index(small(200));
  for (int k = 0; k < 200; ++k) ASSERT_TRUE(index.add(k, ground.frame(30 * k, 30)));
  const auto seen = ground.frame(30 * 77 + 10, 40);  // 20 of number 77, 20 of 78
  const std::vector<int> found = idsOf(index.query(seen, 2, kAny));
  EXPECT_TRUE(found == (std::vector{77, 78}) || found == (std::vector{78, 77}));
  EXPECT_EQ(idsOf(index.query(seen, 1, [](int id) { return id < 78; })), std::vector{77});
}

TEST(PlaceIndex, EmptyOfOneAndFullItAnswersQueriesAndRefusesWhatItCannotHold) {
  Ground ground(600);
  PlaceIndex index(small(3));
  EXPECT_TRUE(index.query(ground.frame(0, 30), 5, kAny).empty());
  EXPECT_TRUE(index.add(4, ground.frame(0, 30)));
  EXPECT_FALSE(index.add(4, ground.frame(0, 30))) << "ids must rise";
  EXPECT_FALSE(index.add(5, ground.frame(0, 3))) << "too few features";
  EXPECT_TRUE(index.add(7, ground.frame(100, 30)));
  EXPECT_TRUE(index.add(9, ground.frame(200, 30)));
  EXPECT_FALSE(index.add(11, ground.frame(300, 30)));
  EXPECT_EQ(index.size(), 3U);
  EXPECT_TRUE(index.query(ground.frame(300, 30), 0, kAny).empty());
}

TEST(PlaceIndex, ARemovedPlaceIsNotFoundAndItsMemoryIsReusedEndlessly) {
  Ground ground(3000);
  PlaceIndex index(small(20));
  const std::size_t bytes = index.memoryBytes();
  for (int k = 0; k < 1000; ++k) {
    if (k >= 20) index.remove(k - 20);
    ASSERT_TRUE(index.add(k, ground.frame(30 * (k % 90), 30))) << k;
  }
  index.remove(5);
  EXPECT_EQ(index.size(), 20U);
  EXPECT_EQ(index.memoryBytes(), bytes);
  EXPECT_EQ(idsOf(index.query(ground.frame(30 * (990 % 90), 30), 1, kAny)), std::vector{990});
  for (int k = 980; k < 1000; ++k) index.remove(k);
  EXPECT_TRUE(index.query(ground.frame(30 * (990 % 90), 30), 1, kAny).empty());
}

TEST(PlaceIndex, FrequentFeaturesScoreLessThanRareOnes) {
  Ground ground(4000);
  PlaceIndex index(small(100));
  const auto with = [&](int rare, int rares) {  // 30 objects that all frames show, and some of its own
    FrameFeatures frame = ground.frame(0, 30);
    const FrameFeatures own = ground.frame(rare, rares);
    frame.features.insert(frame.features.end(), own.features.begin(), own.features.end());
    frame.descriptors.insert(frame.descriptors.end(), own.descriptors.begin(), own.descriptors.end());
    return frame;
  };
  for (int k = 0; k < 100; ++k) ASSERT_TRUE(index.add(k, with(30 * (k + 1), 20)));
  const auto found = index.query(with(30 * 51, 10), 2, kAny);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].id, 50);
  EXPECT_GT(2 * found[0].score, 3 * found[1].score);
}

TEST(PlaceIndex, SavedStateGivesTheSameAnswersAndTheSameBytes) {
  Ground ground(3000);
  PlaceIndex index(small(50)), again(small(50));
  for (int k = 0; k < 50; ++k) ASSERT_TRUE(index.add(k, ground.frame(40 * k, 40)));
  for (int k = 0; k < 50; k += 3) index.remove(k);
  std::vector<std::uint8_t> bytes(1 << 20), bytes_again(1 << 20);
  rt::StateWriter writer(bytes), writer_again(bytes_again);
  index.save(writer);
  ASSERT_FALSE(writer.full());
  rt::StateReader reader(writer.written());
  ASSERT_TRUE(again.load(reader));
  again.save(writer_again);
  EXPECT_TRUE(std::ranges::equal(writer.written(), writer_again.written()));
  const auto seen = ground.frame(40 * 22 + 5, 50);
  ASSERT_EQ(idsOf(index.query(seen, 5, kAny)), idsOf(again.query(seen, 5, kAny)));
  for (PlaceIndex* i : {&index, &again}) {
    i->remove(22);
    ASSERT_TRUE(i->add(60, ground.frame(40 * 21, 60)));
  }
  EXPECT_EQ(idsOf(index.query(seen, 5, kAny)), idsOf(again.query(seen, 5, kAny)));
}

TEST(PlaceIndex, ADamagedStateIsRefused) {
  Ground ground(400);
  PlaceIndex index(small(8)), other(small(4));
  for (int k = 0; k < 8; ++k) ASSERT_TRUE(index.add(k, ground.frame(40 * k, 40)));
  std::vector<std::uint8_t> bytes(1 << 20);
  rt::StateWriter writer(bytes);
  index.save(writer);
  rt::StateReader reader(writer.written());
  EXPECT_FALSE(other.load(reader));
}

// Rendered seafloor, lines and then visits at any heading; a visit shares at least a third with some frame.
TEST(PlaceIndex, RecognisesRenderedSeafloorAtAnyHeading) {
  const test::Seafloor reef{
      [](double n, double e) { return 2.0 + 0.10 * std::sin(2.1 * n + 0.3) * std::cos(1.7 * e); },
      test::randomTexture(0.006, 1)};
  FeatureConfig config;
  config.max_features = 400;
  FeatureExtractor extractor(test::smallRig(), config);
  std::uint32_t shots = 0;
  const auto at = [&](double north, double east, double yaw) {
    const auto images = test::shoot(reef, test::smallRig(), test::lookingDown(north, east, 0, yaw), ++shots);
    return extractor.process(images.first.view(), images.second.view());
  };
  PlaceIndex index({});
  constexpr int kFrames = 14;
  for (int k = 0; k < kFrames; ++k) ASSERT_TRUE(index.add(k, at(0.9 * k, 0, 0)));
  constexpr int kVisits = 6;
  int first = 0;
  for (int k = 0; k < kVisits; ++k) {
    const int where = (5 * k + 2) % kFrames;
    const auto found = index.query(at(0.9 * where + 0.2, 0.15, 1.05 * k), 1, kAny);
    ASSERT_EQ(found.size(), 1U);
    first += std::abs(found[0].id - where) <= 1;
  }
  EXPECT_EQ(first, kVisits);
}

// Two passes: frames 0 to 49 northwards, 100 to 149 eastwards across them, 0.5 m apart.
SE3 placeOf(int frame) {
  if (frame < 100) return lookingDown(0.5 * frame, 0, 0, 0);
  return lookingDown(10, 0.5 * (frame - 120), 0, 1.6);
}

RelativePrior odometry(int x, int y) {
  return {placeOf(x).inverse() * placeOf(y), 1e-4 * Matrix6d::Identity()};
}

Claim claimOf(int a, int b, int wanted = 3, double baseline = 0.4) {
  return {a, b, placeOf(a).inverse() * placeOf(b), 1e-4 * Matrix6d::Identity(), 50, wanted, baseline};
}

// The same, but the second pass 8 m from where it was.
Claim falseClaim(int a, int b) {
  Claim claim = claimOf(a, b);
  claim.T_a_b = placeOf(a).inverse() * (SE3::fromEuler(0, 0, 0, {8, 3, 0}) * placeOf(b));
  return claim;
}

TEST(Agreement, ThreeClaimsAroundOneCycleComeOutTogetherAndOnce) {
  Agreement agreement;
  EXPECT_TRUE(agreement.add(claimOf(20, 120), odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(21, 121), odometry).empty());
  const auto agreed = agreement.add(claimOf(19, 119), odometry);
  ASSERT_EQ(agreed.size(), 3U);
  EXPECT_EQ(agreed[2].a, 19);
  EXPECT_TRUE(agreement.waiting().empty());
  EXPECT_TRUE(agreement.add(claimOf(22, 122), odometry).empty());
}

TEST(Agreement, ClaimsOfOneFrameOrOfTheSamePairOrFarApartConfirmNothing) {
  Agreement of_one, of_the_other, same, far;
  for (int k = 0; k < 5; ++k) {
    EXPECT_TRUE(of_one.add(claimOf(20, 120 + k), odometry).empty());
    EXPECT_TRUE(of_the_other.add(claimOf(20 + k, 120), odometry).empty());
    EXPECT_TRUE(same.add(claimOf(20, 120), odometry).empty());
    EXPECT_TRUE(far.add(claimOf(10 * k, 100 + 10 * k), odometry).empty());
  }
}

TEST(Agreement, ClaimsFromPlacesTooNearEachOtherAreNotEnough) {
  Agreement agreement;
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(agreement.add(claimOf(20 + k, 120 + k, 3, 1.2), odometry).empty());
  EXPECT_EQ(agreement.add(claimOf(23, 123, 3, 1.2), odometry).size(), 4U);
}

TEST(Agreement, FalseClaimsThatDifferStayUnconfirmedAndDoNotStopTrueOnes) {
  Agreement agreement;
  EXPECT_TRUE(agreement.add(falseClaim(20, 120), odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(19, 119), odometry).empty());
  Claim turned = falseClaim(21, 121);
  turned.T_a_b = turned.T_a_b * SE3::fromEuler(0, 0, 0.2, {0.3, 0, 0});
  EXPECT_TRUE(agreement.add(turned, odometry).empty());
  EXPECT_TRUE(agreement.add(claimOf(22, 122), odometry).empty());
  EXPECT_EQ(agreement.add(claimOf(18, 118), odometry).size(), 3U);
  EXPECT_EQ(agreement.waiting().size(), 2U);
}

TEST(Agreement, WhenFullTheOldestIsDroppedAndARemovedFramesClaimsToo) {
  Agreement agreement;
  for (std::size_t k = 0; k < Agreement::kWaiting + 10; ++k) {
    Claim alone = claimOf(20, 120);
    alone.a = 1000 * static_cast<int>(k);
    EXPECT_TRUE(agreement.add(alone, [](int, int) { return RelativePrior{}; }).empty());
  }
  EXPECT_EQ(agreement.waiting().size(), Agreement::kWaiting);
  EXPECT_EQ(agreement.forgotten(), 10U);
  agreement.remove(20000);
  EXPECT_EQ(agreement.waiting().size(), Agreement::kWaiting - 1);
}

TEST(Recognition, APoseThatTiltsTheGroundOrChangesTheDepthIsRefused) {
  const SE3 a = lookingDown(0, 0, 20, 0.3, 0.05, -0.03), b = lookingDown(0.4, 0.2, 20.2, 2.0);
  const SE3 T_a_b = a.inverse() * b;
  // Lost: another place and heading, but down and depth as they are.
  const SE3 lost = lookingDown(90, -40, 20.2, -1.1);
  EXPECT_TRUE(fitsDownAndDepth(a, lost, T_a_b));
  EXPECT_FALSE(fitsDownAndDepth(a, lookingDown(90, -40, 21.2, -1.1), T_a_b));
  EXPECT_FALSE(fitsDownAndDepth(a, lookingDown(90, -40, 20.2, -1.1, 0.15), T_a_b));
}

}  // namespace
}  // namespace fathom::closure
