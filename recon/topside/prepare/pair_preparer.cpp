#include "recon/topside/prepare/pair_preparer.hpp"

#include <optional>
#include <vector>

#include "firmware_if/mission/feature_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/closure/feature_extractor.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/stereo/given_stereo.hpp"
#include "recon/stereo/point_filter.hpp"
#include "recon/stereo/seed_plane.hpp"
#include "recon/topside/light/pair_images.hpp"

namespace fathom::topside {
namespace {

constexpr double kNearestFeature = 0.4,
                 kFarthestFeature =
                     2.5;  // of a feature, in ranges to the seafloor: relief of a reef and its edge

closure::DepthRange depthsAbout(const stereo::SeedPlane& plane) {
  return {kNearestFeature * plane.ahead(), kFarthestFeature * plane.ahead()};
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
  FromImages(const MissionInput& input, const TopsideConfig& config, const LightingModels& lighting,
             bool localised)
      : config_(config), images_(input, lighting) {
    if (localised) {
      closure::FeatureConfig features;
      features.max_features = config.slam_features;
      if (!input.navigated) {
        // Nothing but the images tells where they were taken.
        constexpr int kWidth = 1400, kFeatures = 1500;
        features.max_width = kWidth;
        features.max_features = kFeatures;
      }
      extractor_.emplace(input.rig, features);
    }
    if (config.dense_stereo) {
      dense_.emplace(input.rig, config.stereo, config.dense);
    } else {
      stereo::SparseStereoConfig sparse = config.stereo;
      sparse.look_again = true;
      sparse_.emplace(input.rig, sparse);
    }
  }

  PreparedPair process(const ImagePair& pair, const stereo::SeedPlane& plane) override {
    PreparedPair out;
    ThreadStopwatch watch;
    if (!images_.read(pair)) {
      out.unreadable = images_.error();
      return out;
    }
    out.times[PairStage::kRead] = watch.lap();
    images_.correct(plane);
    out.times[PairStage::kLighting] = watch.lap();
    stereo::SeedPlane ground = plane;
    const auto match = [&]() -> const stereo::StereoResult& {
      return dense_ ? dense_->process(images_.left(), images_.right(), ground)
                    : sparse_->process(images_.left(), images_.right(), ground);
    };
    const stereo::StereoResult& found = match();
    stereo::matchWhereGroundIs(found, ground, scratch_, [&](bool by_range) {
      if (by_range)
        images_.correct(ground);
      else
        images_.correctWithoutRanges();
      (void)match();
    });
    take(found, out);
    out.times[PairStage::kStereo] = watch.lap();
    if (extractor_)
      out.features = extractor_->process(images_.left(), images_.right(), depthsAbout(ground), ground.normal);
    out.times[PairStage::kFeatures] = watch.lap();
    if (enough(found, config_)) {
      stereo::StereoResult surface = found;
      if (sparse_) stereo::smoothPoints(surface);  // dense stereo's matches are smooth
      out.unlit = images_.unlit(ground);
      out.mesh = out.unlit ? stereo::toMesh(surface, {}) : coloured(surface, ground);
    }
    out.times[PairStage::kMesh] = watch.lap();
    return out;
  }

 private:
  Mesh coloured(const stereo::StereoResult& found, const stereo::SeedPlane& plane) {
    std::vector<Eigen::Vector3f> points;
    for (const stereo::StereoPoint& p : found.points) points.push_back(p.point);
    const RgbImage colours = images_.colours(plane, points);
    return stereo::toMesh(found, {colours.rgb.data(), colours.width, colours.height,
                                  3 * static_cast<std::size_t>(colours.width), PixelFormat::kRgb, 8});
  }

  const TopsideConfig& config_;
  PairImages images_;
  std::vector<double> scratch_;
  std::optional<closure::FeatureExtractor> extractor_;
  std::optional<stereo::SparseStereo> sparse_;
  std::optional<stereo::DenseStereo> dense_;  // if configured, instead
};

class FromFeatureFiles final : public PairPreparer {
 public:
  FromFeatureFiles(const MissionInput& input, const TopsideConfig& config, bool localised)
      : input_(input), config_(config), localised_(localised), stereo_(input.rig, config.stereo) {
    limits_.max_features = config.slam_features;
  }

  PreparedPair process(const ImagePair& pair, const stereo::SeedPlane& plane) override {
    PreparedPair out;
    ThreadStopwatch watch;
    try {
      io::readFeatureFile(input_.paths.features() / io::featureFileName(pair.left), frame_);
    } catch (const InputError& error) {
      out.unreadable = error.what();
      return out;
    }
    out.times[PairStage::kRead] = watch.lap();
    if (localised_) {
      limits_.depths = depthsAbout(plane);
      closure::featuresFrom(frame_, input_.rig, limits_, out.features);
    }
    out.times[PairStage::kFeatures] = watch.lap();
    const stereo::StereoResult& found = stereo_.process(frame_);
    take(found, out);
    out.times[PairStage::kStereo] = watch.lap();
    if (enough(found, config_)) stereo::toMesh(found, frame_, out.mesh);
    out.times[PairStage::kMesh] = watch.lap();
    return out;
  }

 private:
  const MissionInput& input_;
  const TopsideConfig& config_;
  bool localised_;
  stereo::GivenStereo stereo_;
  closure::GivenFeatureLimits limits_;
  StereoFeatureFrame frame_;
};

}  // namespace

std::unique_ptr<PairPreparer> makePreparer(const MissionInput& input, const TopsideConfig& config,
                                           const LightingModels& lighting, bool localised) {
  if (input.features_only) return std::make_unique<FromFeatureFiles>(input, config, localised);
  return std::make_unique<FromImages>(input, config, lighting, localised);
}

}  // namespace fathom::topside
