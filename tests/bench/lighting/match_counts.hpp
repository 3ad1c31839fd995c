#pragma once

#include <array>

#include "tests/bench/common/opencv_stereo.hpp"
#include "tests/bench/lighting/corrections.hpp"

namespace fathom::bench {

// Stereo matches under each correction, over the same pairs: by SparseStereo, which asks corners and windows
// for contrast relative to what is around, and by the OpenCV peer, whose corners pass one threshold an image.
// Outer: pixels farther from the image's centre than two thirds of half its diagonal. Correct: disparity
// within 1 px of the true seafloor's.
class MatchCounts {
 public:
  MatchCounts(const TrueMission& mission, int features)
      : mission_(mission),
        features_(features),
        stereo_(mission.rig(), configured(features)),
        peer_(mission.rig()) {}

  struct Count {
    std::size_t all = 0, outer = 0, correct_outer = 0;
    std::size_t peer_all = 0, peer_correct_outer = 0;
  };
  void measure(std::size_t image, const CorrectedPair& pair);
  [[nodiscard]] const Count& count(int correction) const {
    return counts_[static_cast<std::size_t>(correction)];
  }
  [[nodiscard]] std::size_t pairs() const { return pairs_; }

 private:
  static stereo::SparseStereoConfig configured(int features) {
    stereo::SparseStereoConfig config;
    config.max_features = features;
    return config;
  }

  [[nodiscard]] bool isOuter(const Eigen::Vector2d& pixel) const;
  [[nodiscard]] bool isCorrect(std::size_t image, const Eigen::Vector2d& pixel, double z) const;

  const TrueMission& mission_;
  int features_;
  stereo::SparseStereo stereo_;
  stereo::OpenCvStereo peer_;
  std::array<Count, Corrections::kCount> counts_{};
  std::size_t pairs_ = 0;
};

}  // namespace fathom::bench
