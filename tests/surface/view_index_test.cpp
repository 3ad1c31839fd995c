#include "recon/surface/view_index.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace fathom::surface {
namespace {

std::vector<View> scattered(std::size_t count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-40, 40), size(0.1, 3);
  std::vector<View> views(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const double north = place(random), east = place(random);
    views[i].image = 100 + i;
    views[i].footprint = {north, east, north + size(random), east + size(random)};
  }
  return views;
}

TEST(ViewIndex, FindsExactlyTheViewsWhoseFootprintsMeetTheBox) {
  for (const std::size_t count : {1U, 8U, 9U, 500U}) {
    const ViewIndex index(scattered(count));
    for (int k = 0; k < 50; ++k) {
      const std::array<double, 4> box{-40.0 + k, 30.0 - k, -38.0 + 1.5 * k, 34.0 - k};
      std::vector<std::uint32_t> expected;
      for (std::uint32_t i = 0; i < count; ++i) {
        const auto& f = index.views()[i].footprint;
        if (f[0] <= box[2] && box[0] <= f[2] && f[1] <= box[3] && box[1] <= f[3]) expected.push_back(i);
      }
      EXPECT_EQ(index.meeting(box), expected);
    }
  }
}

TEST(ViewIndex, OfNothingFindsNothing) {
  EXPECT_TRUE(ViewIndex({}).meeting({-1, -1, 1, 1}).empty());
}

TEST(ViewIndex, PassesOverFootprintsThatAreNotFinite) {
  std::vector<View> views(3);
  views[0].footprint = {0, 0, 1, 1};
  views[1].footprint = {0, std::numeric_limits<double>::quiet_NaN(), 1, 1};
  views[2].footprint = {1, 1, 0, 0};
  EXPECT_EQ(ViewIndex(views).meeting({-5, -5, 5, 5}), std::vector<std::uint32_t>{0});
}

TEST(ViewIndex, FindsManyViewsOfTheSamePlace) {
  std::vector<View> views(100);
  for (View& view : views) view.footprint = {0, 0, 1, 1};
  EXPECT_EQ(ViewIndex(views).meeting({0.5, 0.5, 0.6, 0.6}).size(), 100U);
  EXPECT_TRUE(ViewIndex(views).meeting({1.5, 0.5, 1.6, 0.6}).empty());
}

}  // namespace
}  // namespace fathom::surface
