#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "recon/closure/scale_kernels.hpp"
#include "recon/geometry/image_view.hpp"

namespace fathom::closure {

// A spot that stands out of its surroundings, with a direction of its own.
struct KeyPoint {
  float x = 0, y = 0;  // [px of the image; 0, 0 is the centre of the top left one]
  float size = 0;      // diameter: twice the standard deviation of the Gaussian that it fits best [px]
  float turn = 0;      // of the gradient around it, from the image's x towards its top [turns, 0 to 1]
  float response = 0;  // of the difference of Gaussians, where an image's values are 0 to 1
  int octave = 0, layer = 0;
};

// Scale-invariant key points and their descriptors (SIFT: Lowe 2004, sections 3 to 6) of one image after the
// other. The same bytes on every processor, and one scale space serves detection and description; memory
// stays for the next image.
class ScaleSpace {
 public:
  static constexpr int kDescriptor = 128;  // 4 by 4 places, 8 directions

  // `contrast`: least response, the sensitivity.
  explicit ScaleSpace(double contrast);

  // `image`: 8-bit mono; one of less than 8 px a side has none. The strongest first. Valid to the next call.
  const std::vector<KeyPoint>& detect(const ImageView& image);

  // Of a key point that the last detect() found: its histogram of gradients, none above a fifth of their
  // norm.
  void describe(const KeyPoint& point, std::span<float, kDescriptor> histogram) const;

 private:
  static constexpr int kLayers = 3;  // of an octave in which extrema are sought

  // At every second pixel of every second row, from (0, 0): what is blurred so much has no detail between.
  struct Gradients {
    std::vector<float> strength, turn;  // [turns, 0 to 1]
  };
  // The image at twice its size, halved once for each octave before.
  struct Octave {
    int width = 0, height = 0;
    std::array<std::vector<float>, kLayers + 3> blurred;  // ever more, by a third of an octave
    std::array<std::vector<float>, kLayers + 2>
        differences;                           // blurred[k + 1] - blurred[k], values of 0 to 255
    std::array<Gradients, kLayers> gradients;  // of blurred[1], ...

    [[nodiscard]] std::size_t at(int x, int y) const {
      return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    }
    [[nodiscard]] std::size_t atGradient(int i, int j) const {
      return static_cast<std::size_t>(j) * static_cast<std::size_t>(width / 2) + static_cast<std::size_t>(i);
    }
    [[nodiscard]] float difference(int layer, int x, int y) const {
      return differences[static_cast<std::size_t>(layer)][at(x, y)];
    }
    [[nodiscard]] bool isExtremum(int layer, int x, int y) const;
  };

  void build(const ImageView& image);
  void blur(const Octave& octave, const std::vector<float>& in, const std::vector<float>& weights,
            std::vector<float>& out);
  void findIn(int octave);
  void refine(int octave, int layer, int x, int y);
  void addTurns(KeyPoint point);

  scale::ScaleKernels kernels_;
  double contrast_;
  std::array<std::vector<float>, kLayers + 3>
      weights_;  // of the blur from the one before: middle, one off...
  std::vector<Octave> octaves_;
  std::size_t used_ = 0;  // octaves of this image
  std::vector<float> doubled_, padded_;
  std::vector<const float*> rows_;
  std::vector<int> columns_;
  std::vector<KeyPoint> points_;
};

}  // namespace fathom::closure
