#include "recon/stereo/kernels/kernels.hpp"

#include <gtest/gtest.h>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/stereo/synthetic_scene.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig;
using test::Exposure;
using test::Sheet;
using test::SyntheticScene;

StereoResult resultOf(const Kernels& kernels, const SparseStereoConfig& config) {
  // Odd sizes: rows end inside a vector.
  const Sheet floor{[](double x, double y) { return 2.0 + 0.4 * x + 0.1 * y; }};
  static const SyntheticScene scene(croppedRig(333, 251), {floor});
  static const auto images = scene.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  return SparseStereo(scene.rig(), config, &kernels).process(images.first.view(), images.second.view(), {});
}

class KernelsWithWindow : public testing::TestWithParam<int> {};

TEST_P(KernelsWithWindow, EveryInstructionSetGivesTheSameBytes) {
  if (&fastestKernels() == &baselineKernels())
    GTEST_SKIP() << "this processor has no faster instruction set than the baseline";
  SparseStereoConfig config;
  config.window = GetParam();
  config.max_features = 900;
  const StereoResult a = resultOf(baselineKernels(), config), b = resultOf(fastestKernels(), config);
  ASSERT_GE(a.points.size(), 300U);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    ASSERT_EQ(a.points[i].left, b.points[i].left);
    ASSERT_EQ(a.points[i].right, b.points[i].right);
    ASSERT_EQ(a.points[i].point, b.points[i].point);
    ASSERT_EQ(a.points[i].sigma_z, b.points[i].sigma_z);
  }
  EXPECT_EQ(a.triangles, b.triangles);
}

INSTANTIATE_TEST_SUITE_P(Windows, KernelsWithWindow, testing::Values(7, 9, 15, 17, 31));

}  // namespace
}  // namespace fathom::stereo
