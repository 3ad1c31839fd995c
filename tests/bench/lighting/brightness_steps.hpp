#pragma once

#include <array>
#include <string>
#include <vector>

#include "tests/bench/lighting/corrections.hpp"

namespace fathom::bench {

// How brightness jumps where images overlap. The same patches of seafloor, 0.2 m wide, are found in two
// images by the true poses and the true seafloor; b_i, b_j are a patch's mean brightness in either, s_i, s_j
// the standard deviation within it, B the mean of all patches. Rms over a pair of images' patches and
// colours:
//   step    = rms (b_i - b_j) / B
//   jump    = rms (b_i - b_j) / rms (s_i, s_j)
// and the means of both over the pairs of images. No gain or offset changes the jump, be it one for each
// image: neither stretching contrast nor darkening images until nothing is left in them makes it smaller.
struct BrightnessStep {
  double step = 0, jump = 0;
  std::size_t patches = 0;
};

// Which images overlap: the next one in time; the one half a footprint on; one of another line.
enum Neighbour { kNext, kHalfFootprint, kOtherLine, kNeighbours };
inline constexpr std::array<const char*, kNeighbours> kNeighbourNames = {"next image", "half a footprint on",
                                                                         "other line"};

class BrightnessSteps {
 public:
  // Finds the patches, of about `images` images spread over the mission and their neighbours.
  BrightnessSteps(const TrueMission& mission, std::size_t images);

  // Images that patches lie in, ascending.
  [[nodiscard]] std::vector<std::size_t> images() const;
  // Measures an image's patches.
  void measure(std::size_t image, const ImageView& raw, const CorrectedPair& pair);
  [[nodiscard]] BrightnessStep result(int correction, Neighbour neighbour) const;

 private:
  struct Patch {
    std::size_t image;
    Eigen::Vector2d centre;  // [px]
    int half;                // [px]
    // Of red, green and blue, by correction; raw in the depth of the camera.
    std::array<std::array<float, 3>, Corrections::kCount> mean{}, deviation{};
  };
  struct Match {
    std::size_t a, b;  // patches
    Neighbour neighbour;
  };
  void findPatches(std::size_t a, std::size_t b, Neighbour neighbour);

  const TrueMission& mission_;
  std::vector<Patch> patches_;
  std::vector<Match> matches_;
};

}  // namespace fathom::bench
