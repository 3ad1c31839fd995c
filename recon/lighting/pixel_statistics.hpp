#pragma once

#include <cstdint>
#include <vector>

namespace fathom::lighting {

// The samples of one channel within an image: all of a mono image, one of four of a Bayer mosaic, one of
// three of RGB.
struct Channel {
  int column = 0, row = 0;  // first sample; columns count samples, not pixels
  int column_step = 1, row_step = 1;
  int width = 0, height = 0;  // samples of the channel in a row, and rows
};

// Gain and offset that map a sample in parts of full scale to 8 bits: out = 255 (gain * sample + offset).
struct Correction {
  float gain = 1.0F;
  float offset = 0.0F;
};

// What a channel's samples shall look like after correction, in parts of full scale.
struct Target {
  double mean = 0.42;
  double sigma = 0.13;
};

// Mean and variance of a channel's samples over many images, on a lattice of nodes `grid` samples apart.
class PixelStatistics {
 public:
  PixelStatistics(const Channel& channel, int grid);

  // Takes the samples around each node below `saturated` (of `full_scale`). `T`: uint8_t or uint16_t;
  // `stride` in samples.
  template <typename T>
  void add(const T* samples, std::size_t stride, float full_scale, float saturated);

  // Nodes' corrections after `images` images, neighbours pooled while images are few.
  void solve(const Target& target, int images);
  // One correction for the whole channel.
  void solveWhole(const Target& target);

  // Corrections of samples first .. first + count - 1 of the channel's row, interpolated; written `step`
  // apart.
  void corrections(int row, int first, int count, float* gain, float* offset, int step) const;

  [[nodiscard]] const Channel& channel() const { return channel_; }

 private:
  struct Moments {
    double count = 0, mean = 0, squares = 0;  // squares: sum of squared differences from the mean
  };
  struct Sums {
    double count = 0, value = 0, squares = 0;
  };
  static void merge(Moments& into, const Moments& other);
  [[nodiscard]] static Correction correction(const Moments& moments, const Target& target);
  [[nodiscard]] Moments whole() const;
  void pool(int radius);

  Channel channel_;
  int grid_;
  int columns_, rows_;  // of nodes; one more than the samples need, for interpolation
  std::vector<Moments> nodes_;
  std::vector<Sums> across_, pooled_;  // over 2 radius + 1 nodes across, then down
  std::vector<Correction> corrections_;
};

}  // namespace fathom::lighting
