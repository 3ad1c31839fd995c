#include "recon/topside/light/pair_images.hpp"

#include "realtime/base/input_error.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::topside {

PairImages::PairImages(const MissionInput& input, const LightingModels& models)
    : input_(input),
      rig_(input.rig),
      models_(models),
      files_(input.cameras()),
      exposures_s_(input.cameras()) {
  for (std::size_t camera = 0; camera < input.cameras(); ++camera)
    ranges_.emplace_back(input.camera(camera), input.T_cam_left(camera));
  if (input.colours) matrix_.emplace(*input.colours);
}

bool PairImages::readCamera(const ImagePair& pair, std::size_t camera) {
  try {
    files_[camera] = input_.image(pair, camera);
    exposures_s_[camera] = pair.exposureOf(camera);

  } catch (const InputError& error) {
    error_ = error.what();
    return false;
  }
  return true;
}

bool PairImages::read(const ImagePair& pair) {
  return readCamera(pair, 0) && readCamera(pair, 1);
}

void PairImages::correctOne(std::size_t camera, const lighting::RangeLattice& ranges,
                            std::vector<std::uint8_t>& mono) {
  const io::ImageFile& file = files_[camera];
  const std::size_t pixels = pixelsOf(input_.camera(camera));
  mosaic_.resize(pixels * samplesPerPixel(file.view.format));
  rgb_.resize(3 * pixels);
  mono.resize(pixels);
  models_.of(camera).grey(file.view, ranges, mosaic_.data(), rgb_.data(), mono.data(), exposures_s_[camera]);
  if (file.mask) fillHidden(mono.data(), 1, *file.mask);
}

void PairImages::correct(const stereo::SeedPlane& plane) {
  (void)correctLeft(plane);
  correctOne(1, ranges_[1].of(plane, {}), right_mono_);
}

void PairImages::correctWithoutRanges() {
  correctOne(0, {}, left_mono_);
  correctOne(1, {}, right_mono_);
}

ImageView PairImages::correctLeft(const stereo::SeedPlane& plane) {
  correctOne(0, ranges_[0].of(plane, {}), left_mono_);
  return left();
}

bool PairImages::unlit(const stereo::SeedPlane& plane) {
  return models_.left.unlit(files_[0].view, ranges_[0].of(plane, {}), exposures_s_[0]);
}

ImageView PairImages::left() const {
  return eightBitView(left_mono_, rig_.left, PixelFormat::kMono, files_[0].view.mask);
}

ImageView PairImages::right() const {
  return eightBitView(right_mono_, rig_.right, PixelFormat::kMono, files_[1].view.mask);
}

RgbImage PairImages::colours(const stereo::SeedPlane& plane, std::span<const Eigen::Vector3f> points,
                             double gain, const lighting::WaterLaw& water, std::size_t camera) {
  const Camera& eye = input_.camera(camera);
  const io::ImageFile& file = files_[camera];
  RgbImage image{eye.width, eye.height, std::vector<std::uint8_t>(3 * pixelsOf(eye))};
  mosaic_.resize(pixelsOf(eye) * samplesPerPixel(file.view.format));
  const lighting::LightingModel& model = models_.of(camera);
  model.colours(file.view, ranges_[camera].of(plane, points), mosaic_.data(), image.rgb.data(),
                {.exposure_s = exposures_s_[camera], .gain = gain, .fall = model.correctionTo(water)});
  if (matrix_ && camera == 0) matrix_->apply(image.rgb);
  if (file.mask) fillHidden(image.rgb.data(), 3, *file.mask);
  return image;
}

}  // namespace fathom::topside
