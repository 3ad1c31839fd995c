#include "recon/topside/stages/feature_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <memory>

#include "firmware_if/feature_file.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/closure/given_features.hpp"
#include "recon/topside/stages/pair_images.hpp"
#include "recon/topside/stages/seed_plane.hpp"

namespace fathom::topside {
namespace {

namespace tbb = oneapi::tbb;

constexpr double kNearest = 0.4,
                 kFarthest = 2.5;  // of a feature, in altitudes: relief of a reef and its edge

// Features of one pair. One object a thread.
class FeatureSource {
 public:
  virtual ~FeatureSource() = default;
  // False when the pair cannot be read.
  [[nodiscard]] virtual bool features(const ImagePair& pair, const stereo::SeedPlane& plane,
                                      closure::FrameFeatures& out) = 0;
};

closure::DepthRange depthsAbout(const stereo::SeedPlane& plane) {
  return {kNearest * plane.distance, kFarthest * plane.distance};
}

class FromImages final : public FeatureSource {
 public:
  FromImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
             const LightingModels& lighting, const closure::FeatureConfig& config)
      : images_(paths, mission, rig, lighting), extractor_(rig, config) {}
  bool features(const ImagePair& pair, const stereo::SeedPlane& plane, closure::FrameFeatures& out) override {
    if (!images_.read(pair)) return false;
    images_.correct(plane);
    out = extractor_.process(images_.left(), images_.right(), depthsAbout(plane));
    return true;
  }

 private:
  PairImages images_;
  closure::FeatureExtractor extractor_;
};

class FromFeatureFiles final : public FeatureSource {
 public:
  FromFeatureFiles(const io::MissionPaths& paths, const StereoRig& rig, int max_features)
      : paths_(paths), rig_(rig) {
    limits_.max_features = max_features;
  }
  bool features(const ImagePair& pair, const stereo::SeedPlane& plane, closure::FrameFeatures& out) override {
    try {
      io::readFeatureFile(paths_.features() / io::featureFileName(pair.left), frame_);
    } catch (const InputError&) {
      return false;
    }
    limits_.depths = depthsAbout(plane);
    closure::featuresFrom(frame_, rig_, limits_, out);
    return true;
  }

 private:
  const io::MissionPaths& paths_;
  const StereoRig& rig_;
  closure::GivenFeatureLimits limits_;
  StereoFeatureFrame frame_;
};

}  // namespace

Frames extractFeatures(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                       const TopsideConfig& config, const LightingModels& lighting, const PairList& list,
                       const Navigation& navigation) {
  const std::vector<ImagePair>& pairs = list.pairs;
  const std::vector<double> altitudes = seedAltitudes(navigation.poses, config.default_altitude);
  std::vector<closure::FrameFeatures> features(pairs.size());
  tbb::enumerable_thread_specific<std::unique_ptr<FeatureSource>> sources;
  closure::FeatureConfig wanted;
  wanted.max_features = config.slam_features;
  const auto make = [&]() -> std::unique_ptr<FeatureSource> {
    if (list.features_only) return std::make_unique<FromFeatureFiles>(paths, rig, wanted.max_features);
    return std::make_unique<FromImages>(paths, mission, rig, lighting, wanted);
  };
  SharedProgress progress("features", pairs.size());
  tbb::parallel_for(std::size_t{0}, pairs.size(), [&](std::size_t k) {
    std::unique_ptr<FeatureSource>& source = sources.local();
    if (!source) source = make();
    progress.step();
    const auto& pose = navigation.poses[k].T_nav_body;
    if (!pose || !source->features(pairs[k], seedPlane(mission, *pose, altitudes[k]), features[k]))
      features[k] = {};
  });
  Frames frames;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const auto& pose = navigation.poses[k].T_nav_body;
    if (!pose) continue;
    frames.with_features += features[k].size() > 0 ? 1U : 0U;
    frames.pair.push_back(static_cast<std::uint32_t>(k));
    frames.features.push_back(std::move(features[k]));
    const SE3 T_nav_cam = *pose * mission.T_body_cam;
    const double step =
        frames.reckoned.empty() ? 0 : (T_nav_cam.translation() - frames.reckoned.back().translation()).norm();
    frames.way.push_back(frames.way.empty() ? 0 : frames.way.back() + step);
    frames.reckoned.push_back(T_nav_cam);
    frames.altitude.push_back(seedPlane(mission, *pose, altitudes[k]).distance);
  }
  return frames;
}

}  // namespace fathom::topside
