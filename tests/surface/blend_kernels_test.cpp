#include "recon/surface/kernels/blend_kernels.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "tests/world/painted_seafloor.hpp"

namespace fathom::surface {
namespace {

constexpr int kNodes = 211;  // no multiple of any vector

struct Points {
  std::vector<float> x, y, z, nx, ny, nz;
  Points() {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> place(-1.5F, 1.5F), tilt(-0.5F, 0.5F);
    for (int i = 0; i < kNodes; ++i) {
      x.push_back(place(random)), y.push_back(place(random)), z.push_back(2 + 0.3F * place(random));
      Eigen::Vector3f n(tilt(random), tilt(random), -1);
      if (i % 17 == 0) n = -n;                               // faces away
      if (i % 23 == 0) z[static_cast<std::size_t>(i)] = -1;  // behind the camera
      n.normalize();
      nx.push_back(n.x()), ny.push_back(n.y()), nz.push_back(n.z());
    }
  }
  [[nodiscard]] NodePoints get() const {
    return {kNodes, x.data(), y.data(), z.data(), nx.data(), ny.data(), nz.data()};
  }
};

struct Pixels {
  std::vector<float> u, v, depth, centrality, freedom;
  explicit Pixels(const BlendKernels& kernels)
      : u(kNodes), v(kNodes), depth(kNodes), centrality(kNodes), freedom(kNodes) {
    const ViewProjection view(sceneCamera(), SE3::fromEuler(0.1, -0.05, 0.3, {0.1, 0, 0}),
                              Eigen::Vector3d::Zero());
    kernels.projectNodes(view, Points().get(), 20,
                         {u.data(), v.data(), depth.data(), centrality.data(), freedom.data()});
  }
};

BandImage noisyImage() {
  std::mt19937 random(5);
  RgbImage image{340, 256, std::vector<std::uint8_t>(3 * 340 * 256)};
  for (auto& value : image.rgb) value = static_cast<std::uint8_t>(random());
  return makeBands(image, {});
}

// Everything that a table of kernels gives.
std::vector<float> resultsOf(const BlendKernels& kernels) {
  const BandImage bands = noisyImage();
  const Pixels at(kernels);
  std::vector<float> all;
  const auto keep = [&](const auto& values) { all.insert(all.end(), values.begin(), values.end()); };
  keep(at.u), keep(at.v), keep(at.depth), keep(at.centrality), keep(at.freedom);
  std::vector<float> weights(3 * kNodes), sums(2 * kNodes), colour(4 * kNodes), fine(4 * kNodes);
  for (std::size_t k = 0; k < 3; ++k)
    kernels.weigh(at.centrality.data(), at.freedom.data(), kNodes, static_cast<float>(5 + 20 * k),
                  &weights[k * kNodes]);
  kernels.normalise(weights.data(), 3, kNodes, kNodes, sums.data());
  keep(weights);
  kernels.gatherBands(bands.fine, bands.coarse, at.u.data(), at.v.data(), weights.data(), &weights[kNodes],
                      &weights[2 * kNodes], kNodes, colour.data(), fine.data());
  keep(colour), keep(fine);
  constexpr int kStep = ChartLattice::kStep;
  std::vector<CellView> views(3);
  for (std::size_t k = 0; k < views.size(); ++k) {
    const auto shift = static_cast<float>(k);
    views[k].pixels = bands.image.rgb.data();
    views[k].stride = 3 * bands.image.width;
    views[k].limit_u = 337.9F, views[k].limit_v = 254.9F;
    views[k].u = {332.2F + shift, 339.7F, 331.9F, 339.1F + shift},
    views[k].v = {-1.3F, 0.4F + shift, 6.8F, 7.9F};
    views[k].weight = {0.2F, 0.5F, 0.1F * shift, 0.3F};
  }
  const std::vector<float> base{10, 20, 30, 0, 40, 50, 60, 0, 70, -80, 90, 0, 1, 2, 3, 0};
  std::vector<std::uint8_t> texels(2 * 3 * kStep * kStep);
  std::vector<std::uint32_t> chosen(kStep * kStep);
  kernels.blendCell(views.data(), 3, base.data(), {texels.data(), 3 * kStep, kStep, kStep});
  kernels.bestCell(views.data(), 3, {&texels[3 * kStep * kStep], 3 * kStep, kStep - 1, kStep - 2},
                   chosen.data());
  keep(texels), keep(chosen);
  return all;
}

TEST(ViewProjection, BehindAFlatPortSeesPointsWhereTheCameraDoes) {
  FlatPort port{.air = sceneCamera(), .distance = 0.05, .glass = 0.02};
  port.normal = Eigen::Vector3d(0.03, -0.02, 1).normalized();
  const Camera camera = behindPort(port);
  const SE3 T_nav_cam = SE3::fromEuler(0.1, -0.05, 0.3, {0.1, 0, 0});
  const ViewProjection view(camera, T_nav_cam, Eigen::Vector3d::Zero());
  const Points points;
  std::vector<float> u(kNodes), v(kNodes), depth(kNodes), centrality(kNodes), freedom(kNodes);
  int seen = 0;
  for (const BlendKernels* kernels : {&baselineBlendKernels(), &fastestBlendKernels()}) {
    kernels->projectNodes(view, points.get(), 20,
                          {u.data(), v.data(), depth.data(), centrality.data(), freedom.data()});
    for (std::size_t i = 0; i < kNodes; ++i) {
      const Eigen::Vector3d p = T_nav_cam.inverse() * Eigen::Vector3d(points.x[i], points.y[i], points.z[i]);
      if (p.z() < 0.5 || !camera.contains(camera.project(p))) continue;
      ++seen;
      const Eigen::Vector2d expected = camera.project(p);
      EXPECT_NEAR(u[i], expected.x(), 0.01);
      EXPECT_NEAR(v[i], expected.y(), 0.01);
      const auto single = view.project(points.x[i], points.y[i], points.z[i]);
      EXPECT_TRUE(single.valid);
      EXPECT_NEAR(single.u, expected.x(), 0.01);
    }
  }
  EXPECT_GT(seen, 20);
}

TEST(BlendKernels, GiveTheSameBitsInEveryInstructionSet) {
  const std::vector<float> expected = resultsOf(baselineBlendKernels());
  for (const float value : expected) ASSERT_TRUE(std::isfinite(value));
  EXPECT_EQ(resultsOf(fastestBlendKernels()), expected);
}

TEST(BlendKernels, ProjectAsTheCameraDoes) {
  const Camera camera = sceneCamera();
  const SE3 T_cam_nav = SE3::fromEuler(0.1, -0.05, 0.3, {0.1, 0, 0}).inverse();
  const Points points;
  const Pixels at(baselineBlendKernels());
  int seen = 0;
  for (std::size_t i = 0; i < kNodes; ++i) {
    const Eigen::Vector3d p = T_cam_nav * Eigen::Vector3d(points.x[i], points.y[i], points.z[i]);
    const bool away = i % 17 == 0, behind = i % 23 == 0;
    if (away || behind) {
      EXPECT_EQ(at.freedom[i], 0);
    }
    if (behind) continue;
    const Eigen::Vector2d pixel = camera.project(p);
    if (!camera.contains(pixel)) {
      EXPECT_EQ(at.freedom[i], 0);
      continue;
    }
    EXPECT_NEAR(at.u[i], pixel.x(), 1e-3);
    EXPECT_NEAR(at.v[i], pixel.y(), 1e-3);
    EXPECT_NEAR(at.depth[i], p.z(), 1e-6);
    const double du = (pixel.x() - 169.5) / 169.5, dv = (pixel.y() - 127.5) / 127.5;
    EXPECT_NEAR(at.centrality[i], std::sqrt((du * du + dv * dv) / 2), 1e-4);
    seen += at.freedom[i] > 0;
  }
  EXPECT_GT(seen, 20);
}

TEST(BlendKernels, WeighByAnExponentialOfTheDistanceFromTheCentre) {
  const std::vector<float> centrality{0, 0.1F, 0.5F, 0.99F, 3}, freedom{1, 0.5F, 1, 1, 1};
  std::vector<float> out(5);
  baselineBlendKernels().weigh(centrality.data(), freedom.data(), 5, 50, out.data());
  for (std::size_t i = 0; i < 4; ++i) {
    const double expected = freedom[i] * std::exp(-50.0 * centrality[i]);
    EXPECT_NEAR(out[i] / expected, 1, 1e-5);
  }
  EXPECT_GE(out[4], 0);
  EXPECT_LT(out[4], 1e-30);
}

TEST(BlendKernels, NormaliseTheWeightsOfANodeToOneAndDropTheSmallest) {
  std::vector<float> weights{1, 0, 4e-20F, 1, 0, 4e-20F, 0.01F, 0, 0}, sums(6);
  baselineBlendKernels().normalise(weights.data(), 3, 3, 3, sums.data());
  EXPECT_FLOAT_EQ(weights[0], 0.5F);
  EXPECT_FLOAT_EQ(weights[3], 0.5F);
  EXPECT_EQ(weights[6], 0);
  EXPECT_EQ(weights[1] + weights[4] + weights[7], 0);
  EXPECT_FLOAT_EQ(weights[2] + weights[5] + weights[8], 1);
}

TEST(BandImage, ItsBandsAddUpAndAFlatImageHasOnlyTheLowOne) {
  RgbImage flat{50, 37, std::vector<std::uint8_t>(3 * 50 * 37, 93)};
  const BandImage bands = makeBands(flat, {});
  EXPECT_EQ(bands.image.rgb, flat.rgb);
  EXPECT_EQ(bands.fine.width, 13);
  EXPECT_EQ(bands.fine.height, 10);
  EXPECT_EQ(bands.coarse.width, 4);
  for (const LowPass* pass : {&bands.fine, &bands.coarse})
    for (std::size_t i = 0; i < pass->values.size(); ++i)
      ASSERT_EQ(pass->values[i], i % 4 == 3 ? 0 : 93 * LowPass::kUnit);
}

TEST(BandImage, RestoresFineDetailAndLeavesRampsAlone) {
  RgbImage image{64, 20, std::vector<std::uint8_t>(3 * 64 * 20)};
  for (int y = 0; y < 20; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c)
        image.at(x, y)[c] =
            static_cast<std::uint8_t>(c == 0 ? 2 * x + 3 * y : (c == 1 ? 100 + 40 * (x / 2 % 2) : 50));
  const BandImage bands = makeBands(image, {}), plain = makeBands(image, {.restore = false});
  EXPECT_EQ(plain.image.rgb, image.rgb);
  for (int x = 2; x < 62; ++x) {
    EXPECT_EQ(bands.image.at(x, 10)[0], image.at(x, 10)[0]);
    EXPECT_EQ(bands.image.at(x, 10)[2], 50);
    EXPECT_EQ(bands.image.at(x, 10)[1], x / 2 % 2 == 0 ? 97 : 143);
  }
}

TEST(BandImage, ReducedIsTheMeanOfSquares) {
  RgbImage image{9, 6, std::vector<std::uint8_t>(3 * 9 * 6)};
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 9; ++x) image.at(x, y)[1] = static_cast<std::uint8_t>((x % 2) * 40 + (y % 2) * 80);
  const BandImage bands = makeBands(image, {.reduction = 2});
  EXPECT_EQ(bands.image.width, 4);
  EXPECT_EQ(bands.image.height, 3);
  for (std::size_t i = 0; i < bands.image.rgb.size(); ++i) EXPECT_EQ(bands.image.rgb[i], i % 3 == 1 ? 60 : 0);
}

}  // namespace
}  // namespace fathom::surface
