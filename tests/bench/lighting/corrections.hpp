#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "recon/lighting/lighting_model.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "tests/bench/common/true_mission.hpp"

namespace fathom::bench {

// The reference as it is written: mean and variance of every pixel by Welford's recurrence over all images,
// nothing pooled, nothing left out but saturated samples.
class PixelWelford {
 public:
  explicit PixelWelford(std::size_t samples) : mean_(samples), squares_(samples), count_(samples) {}
  void add(const ImageView& image, double saturated);
  void correct(const ImageView& image, const lighting::LightingConfig& config, std::uint8_t* out) const;

 private:
  std::vector<double> mean_, squares_, count_;
};

// The left and right images of one pair under all corrections, in their own formats, 8 bits.
struct CorrectedPair {
  std::vector<std::vector<std::uint8_t>> left, right;  // by correction
};

// Every way of correcting that is compared, learnt over one mission.
class Corrections {
 public:
  enum Kind { kRaw, kReference, kWhole, kPlain, kRange, kRangeBent, kAuto, kCount };
  static const char* name(int kind);

  // Learns from `count` pairs spread over the mission.
  Corrections(const TrueMission& mission, std::size_t count);

  // Raw is scaled so that the mission's brightest images just fit: contrast as an 8-bit camera would have it.
  [[nodiscard]] CorrectedPair correct(const io::ImageFile& left, const io::ImageFile& right,
                                      const stereo::SeedPlane& plane);
  [[nodiscard]] lighting::LightingModel::Report report(int kind) const {
    return models_[kind].left->report();
  }

 private:
  struct Models {
    std::unique_ptr<lighting::LightingModel> left, right;
  };
  // Ranges of the plane, and those bent to the stereo points that the images under the range-dependent model
  // give.
  void findRanges(const io::ImageFile& left, const io::ImageFile& right, const stereo::SeedPlane& plane);

  const TrueMission& mission_;
  stereo::SparseStereo stereo_;
  lighting::LightingConfig config_;
  PixelWelford reference_left_, reference_right_;
  Models models_[kCount];
  lighting::RigRanges plane_, bent_;
};

// An 8-bit image of the left or right camera as grey.
[[nodiscard]] std::vector<std::uint8_t> grey(const std::vector<std::uint8_t>& image, const Camera& camera,
                                             PixelFormat format);

}  // namespace fathom::bench
