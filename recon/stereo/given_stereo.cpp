#include "recon/stereo/given_stereo.hpp"

#include <algorithm>
#include <stdexcept>

namespace fathom::stereo {
namespace {

std::size_t capacityOf(const SparseStereoConfig& config) {
  return static_cast<std::size_t>(std::max(config.max_features, 1));
}

}  // namespace

GivenStereo::GivenStereo(const StereoRig& rig, const SparseStereoConfig& config)
    : rig_(rig), config_(config), found_(rig, capacityOf(config)), mesh_(capacityOf(config)) {
  if (!(rig.baseline() > 0) || rig.left.width < 1 || rig.left.height < 1)
    throw std::invalid_argument("given stereo: the rig has no baseline or no image size");
  result_.matches.reserve(capacityOf(config));
  result_.points.reserve(capacityOf(config));
  result_.triangles.reserve(2 * capacityOf(config));
}

void GivenStereo::setRig(const StereoRig& rig) {
  rig_ = rig;
  found_.setRig(rig);
}

const StereoResult& GivenStereo::process(const StereoFeatureFrame& frame) {
  found_.begin(result_);
  if (frame.width != rig_.left.width || frame.height != rig_.left.height) return result_;
  for (const StereoFeature& f : frame.features) {
    if (result_.corners == capacityOf(config_)) break;
    ++result_.corners;
    const Eigen::Vector2d left = f.left.cast<double>(), right = f.right.cast<double>();
    result_.matches.push_back({left, right});
    MatchPoints::Rays rays;
    if (!found_.nearEpipolarLine(config_, left, rig_.left.ray(left), right, rays, result_)) continue;
    const double sigma = static_cast<double>(f.match_sigma);
    found_.add(config_, left, right, rays, sigma * sigma * Eigen::Matrix2d::Identity(), result_);
  }
  found_.widen(result_);
  mesh_.dropOutliers(config_, result_);
  mesh_.triangulate(config_, result_);
  return result_;
}

void toMesh(const StereoResult& result, const StereoFeatureFrame& frame, Mesh& mesh) {
  toMesh(result, ImageView{}, mesh);
  // Points keep the features' order, and their pixels to the bit.
  auto feature = frame.features.begin();
  for (const StereoPoint& p : result.points) {
    feature =
        std::find_if(feature, frame.features.end(), [&](const StereoFeature& f) { return f.left == p.left; });
    if (feature == frame.features.end())
      throw std::invalid_argument("given stereo: a result of another frame");
    mesh.colours.push_back(feature->colour);
  }
}

}  // namespace fathom::stereo
