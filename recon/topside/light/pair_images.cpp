#include "recon/topside/light/pair_images.hpp"

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/eight_bit_view.hpp"

namespace fathom::topside {
namespace {

// `file` corrected, as it was read and in grey.
void correctOne(const lighting::LightingModel& model, const lighting::RangeLattice& ranges,
                const io::ImageFile& file, const Camera& camera, std::vector<std::uint8_t>& corrected,
                std::vector<std::uint8_t>& mono) {
  corrected.resize(pixelsOf(camera) * samplesPerPixel(file.view.format));
  mono.resize(pixelsOf(camera));
  model.correct(file.view, ranges, corrected.data());
  lighting::demosaicMono(eightBitView(corrected, camera, file.view.format), mono.data());
  if (file.mask) fillHidden(mono.data(), 1, *file.mask);
}

}  // namespace

PairImages::PairImages(const MissionInput& input, const LightingModels& models)
    : input_(input), rig_(input.rig), models_(models), ranges_(rig_), left_ranges_(rig_.left) {
  if (input.colours) matrix_.emplace(*input.colours);
}

bool PairImages::readOne(const std::string& name, CameraSide side, io::ImageFile& file) {
  try {
    file = input_.image(name, side);
  } catch (const InputError& error) {
    error_ = error.what();
    return false;
  }
  return true;
}

bool PairImages::readLeft(const ImagePair& pair) {
  return readOne(pair.left, CameraSide::kLeft, left_file_);
}

bool PairImages::read(const ImagePair& pair) {
  return readLeft(pair) && readOne(pair.right, CameraSide::kRight, right_file_);
}

void PairImages::correct(const stereo::SeedPlane& plane) {
  ranges_.fromPlane(plane.normal, plane.distance);
  correctOne(models_.left, ranges_.left(), left_file_, rig_.left, left_, left_mono_);
  correctOne(models_.right, ranges_.right(), right_file_, rig_.right, right_, right_mono_);
}

ImageView PairImages::correctLeft(const stereo::SeedPlane& plane) {
  ranges_.fromPlane(plane.normal, plane.distance);
  correctOne(models_.left, ranges_.left(), left_file_, rig_.left, left_, left_mono_);
  return left();
}

ImageView PairImages::left() const {
  return eightBitView(left_mono_, rig_.left, PixelFormat::kMono, left_file_.view.mask);
}

ImageView PairImages::right() const {
  return eightBitView(right_mono_, rig_.right, PixelFormat::kMono, right_file_.view.mask);
}

RgbImage PairImages::colours(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points,
                             double gain) {
  lighting::RangeLattice ranges;
  left_ranges_.fromPlane(plane.normal, plane.distance, ranges);
  left_ranges_.bendTo(points, ranges);
  left_.resize(pixelsOf(rig_.left) * samplesPerPixel(left_file_.view.format));
  RgbImage image{rig_.left.width, rig_.left.height, std::vector<std::uint8_t>(3 * pixelsOf(rig_.left))};
  models_.left.colours(left_file_.view, ranges, left_.data(), image.rgb.data(), 0, gain);
  if (matrix_) matrix_->apply(image.rgb);
  if (left_file_.mask) fillHidden(image.rgb.data(), 3, *left_file_.mask);
  return image;
}

}  // namespace fathom::topside
