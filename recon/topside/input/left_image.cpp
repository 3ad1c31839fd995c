#include "recon/topside/input/left_image.hpp"

#include "firmware_if/files/images/image_file.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/eight_bit_view.hpp"

namespace fathom::topside {

LeftImages::LeftImages(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                       const LightingModels& models)
    : paths_(paths),
      mission_(mission),
      rig_(rig),
      models_(models),
      ranges_(rig.left),
      corrected_(pixelsOf(rig.left) * samplesPerPixel(mission.cameras.left_format)) {}

std::optional<RgbImage> LeftImages::read(const ImagePair& pair, const stereo::SeedPlane& plane,
                                         std::span<const Eigen::Vector3f> points) {
  const auto& cameras = mission_.cameras;
  io::ImageFile file;
  try {
    file = io::readImage(paths_.images() / pair.left, cameras.left_format, cameras.bits, rig_.left.width,
                         rig_.left.height);
  } catch (const InputError& error) {
    error_ = error.what();
    return std::nullopt;
  }
  lighting::RangeLattice lattice;
  ranges_.fromPlane(plane.normal, plane.distance, lattice);
  ranges_.bendTo(points, lattice);
  models_.left.correct(file.view, lattice, corrected_.data());
  RgbImage image{rig_.left.width, rig_.left.height, std::vector<std::uint8_t>(3 * pixelsOf(rig_.left))};
  lighting::demosaicRgb(eightBitView(corrected_, rig_.left, cameras.left_format), image.rgb.data());
  return image;
}

}  // namespace fathom::topside
