#include "tests/bench/lighting/corrections.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace fathom::bench {
namespace {

ImageView view8(const std::vector<std::uint8_t>& image, const Camera& camera, PixelFormat format) {
  return {image.data(), camera.width, camera.height, static_cast<std::size_t>(camera.width), format, 8};
}

std::size_t pixels(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

// Samples of an image of one sample a pixel, in parts of full scale.
template <typename Function>
void forEachSample(const ImageView& image, Function function) {
  const double full = (1 << image.bits) - 1;
  for (int y = 0; y < image.height; ++y) {
    const auto* row =
        static_cast<const std::uint8_t*>(image.data) + static_cast<std::size_t>(y) * image.stride;
    for (int x = 0; x < image.width; ++x)
      function(
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x),
          (image.bits == 8 ? row[x] : reinterpret_cast<const std::uint16_t*>(row)[x]) / full);
  }
}

std::uint8_t level(double part) {
  return static_cast<std::uint8_t>(std::lround(255 * std::clamp(part, 0.0, 1.0)));
}

lighting::LightingChoice choiceOf(int kind) {
  using lighting::LightingChoice;
  switch (kind) {
    case Corrections::kWhole:
      return LightingChoice::kWholeImage;
    case Corrections::kPlain:
      return LightingChoice::kPlain;
    case Corrections::kAuto:
      return LightingChoice::kAuto;
    default:
      return LightingChoice::kRangeDependent;
  }
}

}  // namespace

void PixelWelford::add(const ImageView& image, double saturated) {
  forEachSample(image, [&](std::size_t k, double value) {
    if (value >= saturated) return;
    count_[k] += 1;
    const double delta = value - mean_[k];
    mean_[k] += delta / count_[k];
    squares_[k] += delta * (value - mean_[k]);
  });
}

void PixelWelford::correct(const ImageView& image, const lighting::LightingConfig& config,
                           std::uint8_t* out) const {
  forEachSample(image, [&](std::size_t k, double value) {
    const double sigma = std::sqrt(squares_[k] / std::max(count_[k] - 1, 1.0));
    out[k] = level(config.target_mean + config.target_sigma * (value - mean_[k]) / std::max(sigma, 0.002));
  });
}

const char* Corrections::name(int kind) {
  constexpr std::array<const char*, kCount> kNames = {"raw",          "reference",     "whole image", "plain",
                                                      "range, plane", "range, stereo", "automatic"};
  return kNames[static_cast<std::size_t>(kind)];
}

Corrections::Corrections(const TrueMission& mission, std::size_t count)
    : mission_(mission),
      stereo_(mission.rig(), {}),
      reference_left_(pixels(mission.rig().left)),
      reference_right_(pixels(mission.rig().right)),
      plane_(mission.rig()),
      bent_(mission.rig()) {
  const StereoRig& rig = mission.rig();
  const auto& cameras = mission.config().cameras;
  for (int kind = kWhole; kind < kCount; ++kind) {
    lighting::LightingConfig config = config_;
    config.choice = choiceOf(kind);
    models_[kind].left = std::make_unique<lighting::LightingModel>(rig.left.width, rig.left.height,
                                                                   cameras.left_format, cameras.bits, config);
    models_[kind].right = std::make_unique<lighting::LightingModel>(
        rig.right.width, rig.right.height, cameras.right_format, cameras.bits, config);
  }
  const std::size_t all = mission.pairs().size();
  count = std::min(count, all);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t index = k * all / count;
    const io::ImageFile left = mission.image(index, CameraSide::kLeft),
                        right = mission.image(index, CameraSide::kRight);
    reference_left_.add(left.view, config_.saturated);
    reference_right_.add(right.view, config_.saturated);
    findRanges(left, right, mission.pairs()[index].plane);
    for (int kind = kWhole; kind < kCount; ++kind) {
      const lighting::RigRanges& ranges = kind == kRange ? plane_ : bent_;
      models_[kind].left->add(left.view, ranges.left());
      models_[kind].right->add(right.view, ranges.right());
    }
  }
}

void Corrections::findRanges(const io::ImageFile& left, const io::ImageFile& right,
                             const stereo::SeedPlane& plane) {
  const StereoRig& rig = mission_.rig();
  const auto& cameras = mission_.config().cameras;
  plane_.fromPlane(plane.normal, plane.distance);
  bent_.fromPlane(plane.normal, plane.distance);
  std::vector<std::uint8_t> left8(pixels(rig.left)), right8(pixels(rig.right));
  models_[kRange].left->correct(left.view, plane_.left(), left8.data());
  models_[kRange].right->correct(right.view, plane_.right(), right8.data());
  left8 = grey(left8, rig.left, cameras.left_format);
  right8 = grey(right8, rig.right, cameras.right_format);
  const stereo::StereoResult& found = stereo_.process(view8(left8, rig.left, PixelFormat::kMono),
                                                      view8(right8, rig.right, PixelFormat::kMono), plane);
  std::vector<Eigen::Vector3f> points, right_points(found.points.size());
  for (const stereo::StereoPoint& p : found.points) points.push_back(p.point);
  bent_.bendTo(points, right_points);
}

CorrectedPair Corrections::correct(const io::ImageFile& left, const io::ImageFile& right,
                                   const stereo::SeedPlane& plane) {
  findRanges(left, right, plane);
  CorrectedPair out;
  out.left.assign(kCount, std::vector<std::uint8_t>(pixels(mission_.rig().left)));
  out.right.assign(kCount, std::vector<std::uint8_t>(pixels(mission_.rig().right)));
  forEachSample(left.view, [&](std::size_t k, double value) { out.left[kRaw][k] = level(value); });
  forEachSample(right.view, [&](std::size_t k, double value) { out.right[kRaw][k] = level(value); });
  reference_left_.correct(left.view, config_, out.left[kReference].data());
  reference_right_.correct(right.view, config_, out.right[kReference].data());
  for (int kind = kWhole; kind < kCount; ++kind) {
    const lighting::RigRanges& ranges = kind == kRange ? plane_ : bent_;
    models_[kind].left->correct(left.view, ranges.left(), out.left[static_cast<std::size_t>(kind)].data());
    models_[kind].right->correct(right.view, ranges.right(),
                                 out.right[static_cast<std::size_t>(kind)].data());
  }
  return out;
}

std::vector<std::uint8_t> grey(const std::vector<std::uint8_t>& image, const Camera& camera,
                               PixelFormat format) {
  std::vector<std::uint8_t> out(pixels(camera));
  lighting::demosaicMono(view8(image, camera, format), out.data());
  return out;
}

}  // namespace fathom::bench
