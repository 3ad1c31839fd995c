#pragma once

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_feature_frame.hpp"
#include "recon/stereo/local_mesh.hpp"
#include "recon/stereo/match_points.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::stereo {

// The points and triangles of features that were matched before: steps 4 and 5 of SparseStereo, with the
// covariance that each feature states for its match. No heap call after construction, except for a frame with
// more features than any before.
class GivenStereo {
 public:
  // Throws std::invalid_argument for a rig without baseline or size. Uses the first `config.max_features` of
  // a frame.
  GivenStereo(const StereoRig& rig, const SparseStereoConfig& config);

  // Changes the rig; image sizes stay.
  void setRig(const StereoRig& rig);

  // The result is reused by the next call. A frame for another image size gives no points.
  const StereoResult& process(const StereoFeatureFrame& frame);

 private:
  StereoRig rig_;
  SparseStereoConfig config_;
  MatchPoints found_;
  LocalMesh mesh_;
  StereoResult result_;
};

// The local mesh of such a result in the left camera frame, with the features' own colours.
void toMesh(const StereoResult& result, const StereoFeatureFrame& frame, Mesh& mesh);

}  // namespace fathom::stereo
