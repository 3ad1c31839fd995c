#include "recon/topside/input/pair_images.hpp"

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/eight_bit_view.hpp"

namespace fathom::topside {

PairImages::PairImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                       const LightingModels& models)
    : paths_(paths),
      mission_(mission),
      rig_(rig),
      models_(models),
      ranges_(rig),
      left_(pixelsOf(rig.left) * samplesPerPixel(mission.cameras.left_format)),
      right_(pixelsOf(rig.right) * samplesPerPixel(mission.cameras.right_format)),
      left_mono_(pixelsOf(rig.left)),
      right_mono_(pixelsOf(rig.right)),
      left_rgb_(pixelsOf(rig.left) * 3) {}

bool PairImages::read(const ImagePair& pair) {
  const auto& cameras = mission_.cameras;
  try {
    left_file_ = io::readImage(paths_.images() / pair.left, cameras.left_format, cameras.bits,
                               rig_.left.width, rig_.left.height);
    right_file_ = io::readImage(paths_.images() / pair.right, cameras.right_format, cameras.bits,
                                rig_.right.width, rig_.right.height);
  } catch (const InputError& error) {
    error_ = error.what();
    return false;
  }
  return true;
}

void PairImages::correct(const stereo::SeedPlane& plane) {
  ranges_.fromPlane(plane.normal, plane.distance);
  models_.left.correct(left_file_.view, ranges_.left(), left_.data());
  models_.right.correct(right_file_.view, ranges_.right(), right_.data());
  lighting::demosaicMono(eightBitView(left_, rig_.left, mission_.cameras.left_format), left_mono_.data());
  lighting::demosaicMono(eightBitView(right_, rig_.right, mission_.cameras.right_format), right_mono_.data());
}

ImageView PairImages::left() const {
  return eightBitView(left_mono_, rig_.left, PixelFormat::kMono);
}

ImageView PairImages::right() const {
  return eightBitView(right_mono_, rig_.right, PixelFormat::kMono);
}

ImageView PairImages::colours(const std::vector<stereo::StereoPoint>& points) {
  std::vector<Eigen::Vector3f> places, right_places(points.size());
  for (const stereo::StereoPoint& p : points) places.push_back(p.point);
  ranges_.bendTo(places, right_places);
  models_.left.correct(left_file_.view, ranges_.left(), left_.data());
  lighting::demosaicRgb(eightBitView(left_, rig_.left, mission_.cameras.left_format), left_rgb_.data());
  return eightBitView(left_rgb_, rig_.left, PixelFormat::kRgb);
}

}  // namespace fathom::topside
