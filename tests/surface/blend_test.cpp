#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "recon/surface/blend.hpp"
#include "tests/support/strip_mask.hpp"
#include "tests/world/painted_seafloor.hpp"

namespace fathom::surface {
namespace {

constexpr double kTexel = 0.004;
constexpr double kLow = -0.25, kHigh = 0.25;
// Of the scenes' seafloor.
const TileMesh kTile = flatTile(kLow, kHigh, SyntheticSeafloor{}.depth, 0.05);

struct Result {
  Atlas atlas;
  BlendCounts counts;
};

Result textured(const SyntheticSeafloor& scene, const TileMesh& tile, const BlendConfig& config,
                const std::vector<const Mesh*>& more = {}) {
  Result out{makeAtlas(tile, {kTexel, 4096, 4}), {}};
  std::vector<const Mesh*> occluders{&tile.mesh};
  occluders.insert(occluders.end(), more.begin(), more.end());
  const ViewIndex index(scene.views);
  TextureBlender blender(scene.camera, config);
  out.counts =
      blender.blend(out.atlas, index, index.meeting({kLow, kLow, kHigh, kHigh}), occluders,
                    TextureBlender::ImageSource([&](std::uint32_t image) { return &scene.pictures[image]; }));
  return out;
}

// Root mean square and greatest difference of texels from `truth`, over those that show a face and that
// `where` admits.
struct Error {
  double rms = 0, greatest = 0;
  int texels = 0;
};
template <typename Where>
Error errorOf(const Atlas& atlas, const SyntheticSeafloor::Paint& truth, const Where& where) {
  std::vector<Texel> texels;
  rasterise(atlas, 0, atlas.height, texels);
  Error out;
  for (int y = 0; y < atlas.height; ++y) {
    for (int x = 0; x < atlas.width; ++x) {
      const Texel& texel = texels[static_cast<std::size_t>(y * atlas.width + x)];
      if (texel.face < 0 || !where(texel.point.x(), texel.point.y())) continue;
      const auto expected = truth(texel.point.x(), texel.point.y());
      for (std::size_t c = 0; c < 3; ++c) {
        const double difference = atlas.tile.atlas.at(x, y)[c] - expected[c];
        out.rms += difference * difference;
        out.greatest = std::max(out.greatest, std::abs(difference));
      }
      ++out.texels;
    }
  }
  out.rms = std::sqrt(out.rms / (3.0 * std::max(out.texels, 1)));
  return out;
}

bool everywhere(double, double) {
  return true;
}

std::array<double, 3> evenPaint(double, double) {
  return {120, 80, 60};
}

SyntheticSeafloor fiveViews() {
  SyntheticSeafloor scene{.camera = sceneCamera(), .paint = seafloorPaint};
  scene.addView(0.0, 0.0, 0.2);
  scene.addView(0.25, 0.1, 0.1, 0.05);
  scene.addView(-0.25, 0.05, -0.1);
  scene.addView(0.1, -0.2, 3.1, -0.04);
  scene.addView(-0.1, 0.2, 0.3);
  return scene;
}

SyntheticSeafloor fiveViewsTaken() {
  SyntheticSeafloor scene = fiveViews();
  scene.take();
  return scene;
}

TEST(Blend, ShowsTheSeafloorAsPainted) {
  SyntheticSeafloor scene = fiveViewsTaken();
  for (const BlendMode mode : {BlendMode::kBands, BlendMode::kAverage, BlendMode::kUnblended}) {
    BlendConfig config;
    config.mode = mode;
    const Result result = textured(scene, kTile, config);
    EXPECT_EQ(result.counts.unseen, 0U);
    EXPECT_EQ(result.counts.outvoted, 0U);
    EXPECT_EQ(result.counts.views, 5U);
    const Error error = errorOf(result.atlas, scene.paint, everywhere);
    EXPECT_GT(error.texels, 15000);
    // The fine waves are six pixels long, and edges are as sharp as a pixel: sampling alone costs this much.
    EXPECT_LT(error.rms, 5) << static_cast<int>(mode);
  }
}

TEST(Blend, AViewFromAfarDoesNotBlurWhatANearOneShows) {
  SyntheticSeafloor scene{.camera = sceneCamera(), .paint = seafloorPaint};
  scene.addView(0.2, 0.2, 0.2);  // at 2 m, beside
  scene.take();
  const auto error = [&] { return errorOf(textured(scene, kTile, {}).atlas, scene.paint, everywhere).rms; };
  const double alone = error();
  scene.addView(0, 0, 0.1);
  const SE3& over = scene.views.back().T_nav_cam;
  scene.views.back().T_nav_cam = SE3(over.rotation(), {0, 0, -4});  // at 6 m, right above
  scene.take();
  const double both = error();
  std::printf("off the paint: %.2f from near alone, %.2f from both\n", alone, both);
  EXPECT_LT(both, 1.1 * alone);
}

TEST(Blend, GivesEverythingOfAnImageBackWhereItIsTheOnlyOne) {
  SyntheticSeafloor scene{.camera = sceneCamera(), .paint = seafloorPaint};
  scene.addView(0, 0, 0.4);
  scene.take();
  BlendConfig bands, unblended;
  unblended.mode = BlendMode::kUnblended;
  const Result a = textured(scene, kTile, bands), b = textured(scene, kTile, unblended);
  ASSERT_EQ(a.atlas.tile.atlas.rgb.size(), b.atlas.tile.atlas.rgb.size());
  int differing = 0;
  for (std::size_t i = 0; i < a.atlas.tile.atlas.rgb.size(); ++i)
    differing += std::abs(a.atlas.tile.atlas.rgb[i] - b.atlas.tile.atlas.rgb[i]) > 1;
  EXPECT_EQ(differing, 0);
}

TEST(Blend, HidesDifferencesOfExposureWithoutLosingDetail) {
  SyntheticSeafloor scene = fiveViews();
  scene.gains = {1.0, 1.15, 0.88, 1.1, 0.92};
  scene.take();
  BlendConfig config;
  const Result blended = textured(scene, kTile, config);
  config.mode = BlendMode::kUnblended;
  const Result unblended = textured(scene, kTile, config);
  EXPECT_EQ(blended.counts.outvoted, 0U);  // a gain is no reason to be left out
  EXPECT_LT(errorOf(blended.atlas, scene.paint, everywhere).rms,
            0.9 * errorOf(unblended.atlas, scene.paint, everywhere).rms);
}

TEST(Blend, DoesNotPaintWhatHidesASurfaceOntoIt) {
  SyntheticSeafloor scene = fiveViews();
  // A ledge half a metre above the seafloor, and a rod as thin as a voxel.
  scene.plates = {{{0.02, -0.30, 0.20, 0.02}, 1.5, {250, 20, 20}},
                  {{-0.2, 0.10, 0.2, 0.135}, 1.6, {20, 250, 20}}};
  scene.take();
  const Mesh ledge = plateMesh(scene.plates[0]), rod = plateMesh(scene.plates[1]);
  BlendConfig config;
  config.vote = false;
  const Result aware = textured(scene, kTile, config, {&ledge, &rod}), blind = textured(scene, kTile, config);
  const auto painted = [&](const Result& result) {
    int count = 0;
    std::vector<Texel> texels;
    rasterise(result.atlas, 0, result.atlas.height, texels);
    for (int y = 0; y < result.atlas.height; ++y) {
      for (int x = 0; x < result.atlas.width; ++x) {
        const std::uint8_t* texel = result.atlas.tile.atlas.at(x, y);
        const bool red = texel[0] > 200 && texel[1]<70, green = texel[1]> 180 && texel[0] < 70;
        count += texels[static_cast<std::size_t>(y * result.atlas.width + x)].face >= 0 && (red || green);
      }
    }
    return count;
  };
  EXPECT_GT(painted(blind), 500);
  EXPECT_EQ(painted(aware), 0);
  EXPECT_GT(aware.counts.occluded, 0U);
}

TEST(Blend, LeavesOutAFishThatOneOfFiveViewsSaw) {
  SyntheticSeafloor scene = fiveViewsTaken();
  BlendConfig config;
  const Result clean = textured(scene, kTile, config);
  SyntheticSeafloor with_fish = scene;
  // It swims 20 cm above the middle, where the first view is the most central one.
  with_fish.plates = {{{-0.10, -0.05, 0.10, 0.05}, 1.8, {20, 25, 40}}};
  scene.pictures[0] = with_fish.picture(0);
  const Result voted = textured(scene, kTile, config);
  config.vote = false;
  const Result credulous = textured(scene, kTile, config);
  const auto fishOf = [&](const Result& result) {
    int texels = 0;
    for (std::size_t i = 0; i + 2 < result.atlas.tile.atlas.rgb.size(); i += 3)
      texels += result.atlas.tile.atlas.rgb[i] + 25 < clean.atlas.tile.atlas.rgb[i];
    return texels;
  };
  EXPECT_GT(voted.counts.outvoted, 0U);
  EXPECT_GT(fishOf(credulous), 800);
  EXPECT_EQ(fishOf(voted), 0);
  const Error error = errorOf(voted.atlas, scene.paint, everywhere);
  EXPECT_LT(error.rms, 1.2 * errorOf(clean.atlas, scene.paint, everywhere).rms);
}

// A strip across the middle of every image, filled with about the seafloor's mean.
TEST(Blend, LeavesOutWhatMasksHide) {
  SyntheticSeafloor scene = fiveViewsTaken();
  const int width = scene.camera.width, height = scene.camera.height;
  constexpr std::uint8_t kFilled = 110;
  for (const int reduction : {1, 2}) {
    BlendConfig config;
    config.vote = false;
    config.bands.reduction = reduction;
    const auto rmsOf = [&](bool masked) {
      Atlas atlas = makeAtlas(kTile, {kTexel, 4096, 4});
      const ViewIndex index(scene.views);
      TextureBlender blender(scene.camera, config);
      (void)blender.blend(atlas, index, index.meeting({kLow, kLow, kHigh, kHigh}), {&kTile.mesh},
                          TextureBlender::BandSource([&](std::uint32_t image) {
                            const int first = width * (image % 2 == 0 ? 3 : 4) / 8;
                            RgbImage picture = scene.pictures[image];
                            for (int y = 0; y < height; ++y)
                              std::fill_n(picture.at(first, y), 3 * (width / 4), kFilled);
                            auto mask = std::make_shared<ImageMask>(
                                test::stripMask(width, height, first, first + width / 4 - 1));
                            return std::make_shared<const BandImage>(
                                makeBands(std::move(picture), config.bands, masked ? mask : nullptr));
                          }));
      return errorOf(atlas, scene.paint, everywhere).rms;
    };
    const double seen = rmsOf(false), hidden = rmsOf(true);
    std::printf("rms of the texture: %.1f with a filled strip, %.1f with it hidden\n", seen, hidden);
    EXPECT_LT(hidden, 0.4 * seen);
    EXPECT_LT(hidden, 6);
  }
}

TEST(Blend, KeepsAStrongContrastThatPosesPlaceDifferently) {
  SyntheticSeafloor scene = fiveViews();
  scene.paint = [](double north, double east) -> std::array<double, 3> {
    const bool rock = std::fmod(std::floor(north * 8 + 100) + std::floor(east * 8 + 100), 2) == 0;
    return rock ? std::array<double, 3>{190, 180, 160} : std::array<double, 3>{45, 50, 40};
  };
  scene.take();
  // Poses with errors of 8 mm, each in another direction.
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    const double angle = 1.3 * static_cast<double>(i);
    scene.views[i].T_nav_cam = SE3(scene.views[i].T_nav_cam.rotation(),
                                   scene.views[i].T_nav_cam.translation() +
                                       0.008 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0));
  }
  const Result result = textured(scene, kTile, {});
  EXPECT_EQ(result.counts.outvoted, 0U);
}

TEST(Blend, FillsWhatNoViewSeesFromItsNeighbours) {
  SyntheticSeafloor scene{.camera = sceneCamera(), .paint = evenPaint};
  // It reaches to about north -0.1 only.
  scene.addView(0.7, 0);
  scene.take();
  const Result result = textured(scene, kTile, {});
  EXPECT_GT(result.counts.unseen, 1000U);
  EXPECT_LT(result.counts.unseen, result.counts.texels);
  EXPECT_LE(errorOf(result.atlas, scene.paint, everywhere).greatest, 1);
}

TEST(Blend, OfATileThatNoImageSawShowsTheVerticesColours) {
  SyntheticSeafloor scene{.camera = sceneCamera()};
  TileMesh painted = kTile;
  painted.mesh.colours.assign(painted.mesh.vertices.size(), Rgb{10, 20, 30});
  const Result result = textured(scene, painted, {});
  EXPECT_EQ(result.counts.views, 0U);
  EXPECT_EQ(result.counts.unseen, result.counts.texels);
  for (std::size_t i = 0; i < result.atlas.tile.atlas.rgb.size(); ++i)
    ASSERT_EQ(result.atlas.tile.atlas.rgb[i], 10 * (1 + i % 3));
}

TEST(Blend, PassesOverImagesThatCannotBeHad) {
  SyntheticSeafloor scene = fiveViewsTaken();
  Atlas atlas = makeAtlas(kTile, {kTexel, 4096, 4});
  const ViewIndex index(scene.views);
  TextureBlender blender(scene.camera, {});
  const auto counts = blender.blend(atlas, index, index.meeting({kLow, kLow, kHigh, kHigh}), {&kTile.mesh},
                                    TextureBlender::ImageSource([&](std::uint32_t image) -> const RgbImage* {
                                      return image == 1 ? nullptr : &scene.pictures[image];
                                    }));
  EXPECT_EQ(counts.views, 4U);
  EXPECT_LT(errorOf(atlas, scene.paint, everywhere).rms, 5);
}

TEST(Blend, TakesImagesReducedToLargerTexels) {
  SyntheticSeafloor scene = fiveViewsTaken();
  BlendConfig config;
  config.bands.reduction = 2;
  const Result result = textured(scene, kTile, config);
  EXPECT_EQ(result.counts.unseen, 0U);
  EXPECT_LT(errorOf(result.atlas, scene.paint, everywhere).rms, 12);
}

TEST(Blend, BoundsTheViewsOfAPlaceThatWasPassedManyTimes) {
  SyntheticSeafloor scene{.camera = sceneCamera(), .paint = evenPaint};
  for (int i = 0; i < 60; ++i) scene.addView(0.001 * i, 0.0005 * i);
  scene.pictures.assign(60, scene.picture(0));
  const Result result = textured(scene, kTile, {});
  EXPECT_LE(result.counts.views, 36U);  // twelve at each of a few places
  EXPECT_EQ(result.counts.unseen, 0U);
}

TEST(Blend, DoesNotChangeFromOneCallToTheNext) {
  SyntheticSeafloor scene = fiveViewsTaken();
  const ViewIndex index(scene.views);
  TextureBlender blender(scene.camera, {});
  const auto texture = [&] {
    Atlas atlas = makeAtlas(kTile, {kTexel, 4096, 4});
    blender.blend(atlas, index, index.meeting({kLow, kLow, kHigh, kHigh}), {&kTile.mesh},
                  TextureBlender::ImageSource([&](std::uint32_t image) { return &scene.pictures[image]; }));
    return atlas.tile.atlas.rgb;
  };
  const auto first = texture();
  EXPECT_EQ(first, texture());
}

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
