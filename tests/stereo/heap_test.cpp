#include <gtest/gtest.h>

#include "recon/stereo/sparse_stereo.hpp"
#include "tests/stereo/synthetic_scene.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::stereo {
namespace {

using test::croppedRig;
using test::Sheet;
using test::SyntheticScene;

TEST(SparseStereo, NoFrameCallsTheHeapNotEvenTheFirst) {
  const SyntheticScene flat(croppedRig(640, 480), {Sheet{[](double, double) { return 2.0; }}});
  const SyntheticScene rough(
      croppedRig(640, 480),
      {Sheet{[](double x, double y) { return 2.4 - 0.5 * x + (x * x + y * y < 0.01 ? -0.5 : 0.0); }}}, 0.004,
      5);
  const auto [left, right] = flat.render({1.0, 0.0, 2.0}, {0.8, 12.0, 3.0});
  const auto [other_left, other_right] = rough.render({1.0, 0.0, 6.0}, {0.8, 12.0, 6.0});
  SparseStereoConfig config;
  config.max_features = 1500;
  SparseStereo stereo(flat.rig(), config);
  const auto before = test::threadCost();
  // Few, then as many as configured, then other ground with mismatches, then unrelated images.
  (void)stereo.process(left.view(), right.view(), {}, 100);
  (void)stereo.process(left.view(), right.view(), {});
  (void)stereo.process(other_left.view(), other_right.view(), {Eigen::Vector3d::UnitZ(), 2.4}, 900);
  (void)stereo.process(left.view(), other_right.view(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {}, 1 << 20);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  EXPECT_GE(result.points.size(), 1000U);
}

TEST(StereoMesh, FilledAgainCallsNoHeap) {
  const SyntheticScene scene(croppedRig(320, 240), {Sheet{[](double, double) { return 2.0; }}});
  const auto [left, right] = scene.render({}, {});
  SparseStereo stereo(scene.rig(), {});
  const StereoResult& result = stereo.process(left.view(), right.view(), {});
  Mesh mesh;
  toMesh(result, left.view(), mesh);
  const auto before = test::threadCost();
  toMesh(result, left.view(), mesh);
  EXPECT_EQ((test::threadCost() - before).heap_calls, 0U);
  ASSERT_EQ(mesh.vertices.size(), result.points.size());
  EXPECT_EQ(mesh.colours.size(), result.points.size());
}

}  // namespace
}  // namespace fathom::stereo
