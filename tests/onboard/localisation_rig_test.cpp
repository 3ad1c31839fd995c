// Localisation through a rig that is not what it was taken for.
#include <gtest/gtest.h>

#include <functional>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/calibration/epipolar_check.hpp"
#include "recon/calibration/rig_history.hpp"
#include "tests/onboard/synthetic_survey.hpp"

namespace fathom::onboard {
namespace {

using testing::featureSlots;
using testing::MemorySlots;
using testing::smallLocalisation;
using testing::SyntheticSurvey;
using testing::syntheticSurvey;

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
                       const LocalisationConfig& config = smallLocalisation())
      : dive(std::move(given)), rigs_(wrong), core_(rigs_, config, &slots_) {
    for (std::size_t k = 0; k < dive.frames.size(); ++k) {
      SyntheticSurvey::Frame& frame = dive.frames[k];
      if (k == known) {
        rigs_.add(dive.rig, true);
        correct(core_);
      }
      if (k < known)
        for (closure::Feature& f : frame.features.features) f.point = triangulated(wrong, f);
      LocalisationInput input = frame.input;
      input.features = &frame.features;
      keyframes_.push_back(core_.place(input, core_.look(input)));
    }
    core_.finish();
  }
  [[nodiscard]] SE3 poseOf(std::size_t k) const {
    return core_.poseOf(keyframes_[k], dive.frames[k].input.T_odom_cam);
  }

  SyntheticSurvey dive;

 private:
  calibration::RigHistory rigs_;
  MemorySlots slots_ = featureSlots(300);
  LocalisationCore core_;
  std::vector<int> keyframes_;
};

// Lenses of which one is longer than calibrated turn every step of visual odometry to the same side.
TEST(LocalisationCore, StepsFromBeforeTheRigWasMeasuredAreEstimatedAgain) {
  constexpr std::size_t kMeasured = 12;
  SyntheticSurvey dive = syntheticSurvey();
  dive.frames.resize(4 * kMeasured);
  const StereoRig rig = dive.rig, wrong = calibration::changed(rig, Eigen::Vector3d(0.002, 0, 0.002), 0.003);
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
    const StereoRig wrong = calibration::changed(dive.rig, Eigen::Vector3d::Zero(), 1e-3);
    const std::size_t never = dive.frames.size();
    LocalisationConfig config = smallLocalisation();
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

}  // namespace
}  // namespace fathom::onboard
