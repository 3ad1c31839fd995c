#include "recon/topside/prepare/prepare_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <optional>

#include "firmware_if/files/feature_file.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/closure/given_features.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/given_stereo.hpp"
#include "recon/topside/input/pair_images.hpp"
#include "recon/topside/input/seed_plane.hpp"

namespace fathom::topside {
namespace {

constexpr double kNearest = 0.4,
                 kFarthest = 2.5;  // of a feature, in altitudes: relief of a reef and its edge

closure::DepthRange depthsAbout(const stereo::SeedPlane& plane) {
  return {kNearest * plane.distance, kFarthest * plane.distance};
}

void take(const stereo::StereoResult& found, PreparedPair& out) {
  out.points = found.points.size();
  out.corners = found.corners;
  out.rejected = found.rejected;
}

bool enough(const stereo::StereoResult& found, const TopsideConfig& config) {
  return found.points.size() >= static_cast<std::size_t>(config.min_points) && !found.triangles.empty();
}

class FromImages final : public PairPreparer {
 public:
  FromImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
             const TopsideConfig& config, const LightingModels& lighting, Wanted wanted)
      : mission_(mission), config_(config), images_(paths, mission, rig, lighting) {
    if (wanted.features) {
      closure::FeatureConfig features;
      features.max_features = config.slam_features;
      extractor_.emplace(rig, features);
    }
    if (wanted.mesh && config.dense_stereo) dense_.emplace(rig, config.stereo, config.dense);
    if (wanted.mesh && !config.dense_stereo) sparse_.emplace(rig, config.stereo);
  }

  PreparedPair process(const ImagePair& pair, const SE3& T_nav_body, double altitude) override {
    PreparedPair out;
    ThreadStopwatch watch;
    if (!images_.read(pair)) {
      out.unreadable = images_.error();
      return out;
    }
    out.times[PairStage::kRead] = watch.lap();
    const stereo::SeedPlane plane = seedPlane(mission_, T_nav_body, altitude);
    images_.correct(plane);
    out.times[PairStage::kLighting] = watch.lap();
    if (extractor_) out.features = extractor_->process(images_.left(), images_.right(), depthsAbout(plane));
    out.times[PairStage::kFeatures] = watch.lap();
    if (!dense_ && !sparse_) return out;
    const stereo::StereoResult& found = dense_ ? dense_->process(images_.left(), images_.right(), plane)
                                               : sparse_->process(images_.left(), images_.right(), plane);
    take(found, out);
    out.times[PairStage::kStereo] = watch.lap();
    if (enough(found, config_)) out.mesh = stereo::toMesh(found, images_.colours(found.points));
    out.times[PairStage::kMesh] = watch.lap();
    return out;
  }

 private:
  const io::MissionConfig& mission_;
  const TopsideConfig& config_;
  PairImages images_;
  std::optional<closure::FeatureExtractor> extractor_;
  std::optional<stereo::SparseStereo> sparse_;
  std::optional<stereo::DenseStereo> dense_;  // if configured, instead
};

class FromFeatureFiles final : public PairPreparer {
 public:
  FromFeatureFiles(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                   const TopsideConfig& config, Wanted wanted)
      : paths_(paths),
        mission_(mission),
        rig_(rig),
        config_(config),
        wanted_(wanted),
        stereo_(rig, config.stereo) {
    limits_.max_features = config.slam_features;
  }

  PreparedPair process(const ImagePair& pair, const SE3& T_nav_body, double altitude) override {
    PreparedPair out;
    ThreadStopwatch watch;
    try {
      io::readFeatureFile(paths_.features() / io::featureFileName(pair.left), frame_);
    } catch (const InputError& error) {
      out.unreadable = error.what();
      return out;
    }
    out.times[PairStage::kRead] = watch.lap();
    if (wanted_.features) {
      limits_.depths = depthsAbout(seedPlane(mission_, T_nav_body, altitude));
      closure::featuresFrom(frame_, rig_, limits_, out.features);
    }
    out.times[PairStage::kFeatures] = watch.lap();
    if (!wanted_.mesh) return out;
    const stereo::StereoResult& found = stereo_.process(frame_);
    take(found, out);
    out.times[PairStage::kStereo] = watch.lap();
    if (enough(found, config_)) stereo::toMesh(found, frame_, out.mesh);
    out.times[PairStage::kMesh] = watch.lap();
    return out;
  }

 private:
  const io::MissionPaths& paths_;
  const io::MissionConfig& mission_;
  const StereoRig& rig_;
  const TopsideConfig& config_;
  Wanted wanted_;
  stereo::GivenStereo stereo_;
  closure::GivenFeatureLimits limits_;
  StereoFeatureFrame frame_;
};

}  // namespace

std::unique_ptr<PairPreparer> makePreparer(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                           const StereoRig& rig, const TopsideConfig& config,
                                           const LightingModels& lighting, bool features_only,
                                           Wanted wanted) {
  if (features_only) return std::make_unique<FromFeatureFiles>(paths, mission, rig, config, wanted);
  return std::make_unique<FromImages>(paths, mission, rig, config, lighting, wanted);
}

MemoryFeatureStore prepareFeatures(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                   const StereoRig& rig, const TopsideConfig& config,
                                   const LightingModels& lighting, const PairList& list,
                                   const Navigation& navigation) {
  namespace tbb = oneapi::tbb;
  const std::vector<double> altitudes = seedAltitudes(navigation.poses, config.default_altitude);
  std::vector<closure::FrameFeatures> features(list.pairs.size());
  tbb::enumerable_thread_specific<std::unique_ptr<PairPreparer>> preparers;
  rt::StageProgress progress("features", list.pairs.size());
  tbb::parallel_for(std::size_t{0}, list.pairs.size(), [&](std::size_t k) {
    std::unique_ptr<PairPreparer>& preparer = preparers.local();
    if (!preparer)
      preparer = makePreparer(paths, mission, rig, config, lighting, list.features_only, Wanted{true, false});
    progress.step();
    if (const auto& pose = navigation.poses[k].T_nav_body)
      features[k] = preparer->process(list.pairs[k], *pose, altitudes[k]).features;
  });
  return MemoryFeatureStore(std::move(features));
}

}  // namespace fathom::topside
