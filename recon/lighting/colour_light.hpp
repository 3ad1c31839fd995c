#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "recon/lighting/channel_model.hpp"
#include "recon/lighting/node_statistics.hpp"
#include "recon/lighting/range_lattice.hpp"

namespace fathom::lighting {

// Gain and offset from a sample (as stored) to a grey level of 8 bits.
struct Correction {
  float gain = 1.0F;
  float offset = 0.0F;
};

// Columns of a row's nodes, in the middles of as many equal cells, and the pixels between each two of them.
struct RowPlan {
  RowPlan() = default;
  RowPlan(int row_width, int node_count);

  int width = 0, nodes = 0;                      // pixels, nodes
  float per_pixel = 0;                           // nodes
  std::array<float, NodeLattice::kMaxSide> x{};  // of a node [px]
  std::array<int, NodeLattice::kMaxSide> end{};  // of the stretch after a node [px]
};

// Output of a corrected value: the value itself in grey levels, or the level of sRGB for linear light from 0
// to 1 (IEC 61966-2-1 to half a level, two near black).
enum class Encoding : std::uint8_t { kLevels, kSrgb };

// One row of an image: out = gain * sample + offset, rounded and clamped to 0 to 255. `even` and `odd` are
// the corrections of the pixels in even and odd columns (a mono image: the same) at the nodes; linear between
// them, and on to the row's ends.
template <Encoding kEncoding, typename T>
void correctRow(const RowPlan& plan, const T* in, const Correction* even, const Correction* odd,
                std::uint8_t* out);

// The same for rows of pixels of three interleaved samples.
template <Encoding kEncoding, typename T>
void correctRgbRow(const RowPlan& plan, const T* in, const Correction* const (&channels)[3],
                   std::uint8_t* out);

// The level b that one channel reads without light from the ground: the sensor's black level and uniform
// haze. On the same ground the contrast falls with the brightness m as 1 - b / m. This is fitted to the
// spread of nodes about their expected brightness, in classes of the expected brightness. It uses means over
// nodes, since the noise of single samples would hide the fall.
class Pedestal {
 public:
  // `expected` in parts of full scale; `ratio`: measured over expected.
  void add(float expected, float ratio);
  void solve();
  // What was added counts half from here on.
  void halve();
  [[nodiscard]] float level() const { return level_; }  // parts of full scale

  // For saved state (state_archive.hpp).
  static void exchange(auto& archive, auto& self) {
    archive(self.count_, self.expected_, self.sum_, self.squares_, self.level_);
  }

 private:
  static constexpr int kClasses =
      25;  // half octaves down from full scale, to a sixteenth of a level of 8 bits
  std::array<float, kClasses> count_{}, expected_{}, sum_{}, squares_{};
  float level_ = 0;
};

// Light from a patch of ground over the light from one at the same place that is perpendicular to the
// camera's axis. For a Lambertian patch at p (depth z) with unit normal n (towards the camera) and lamps at
// c, level with the camera, it is n . (c - p) / z. Learnt are the two coordinates of c across the axis and
// the strength of the effect (normals from stereo are smoother than the ground), by linear least squares over
// the ratios of measured to expected light, with a prior of a lamp at the camera.
class TiltResponse {
 public:
  // `ratio`: measured light over that expected of perpendicular ground. Gross outliers are ignored.
  void add(const RangeLattice::Ground& ground, float ratio);
  void solve();
  // What was added counts half from here on.
  void halve();

  // Clamped to kDarkest and kBrightest: beyond them lamps graze the ground and the model does not hold.
  [[nodiscard]] float at(const RangeLattice::Ground& ground) const;
  static constexpr float kDarkest = 0.35F, kBrightest = 1.6F;

  [[nodiscard]] float strength() const { return solution_.x(); }              // 1: Lambert's law
  [[nodiscard]] Eigen::Vector2f lamp() const { return solution_.tail<2>(); }  // camera frame [m]

  // For saved state (state_archive.hpp).
  static void exchange(auto& archive, auto& self) {
    for (auto& value : self.normal_.reshaped()) archive(value);
    for (auto& value : self.right_.reshaped()) archive(value);
    for (auto& value : self.solution_.reshaped()) archive(value);
  }

 private:
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();  // of the least squares
  Eigen::Vector3d right_ = Eigen::Vector3d::Zero();
  Eigen::Vector3f solution_{1, 0, 0};
};

// Turns samples into colours: the albedo over the dive's mean albedo, in linear light
//   light = grey (1 + lift ((in - b) / (f (m - b)) - 1))
// m: mean that ChannelModel expects at the place and range, its light times TiltResponse of the ground; b:
// Pedestal of the channel, above the black level in proportion to the exposure; lift: raises the contrast of
// a hazy dive; f: FallCorrection. Without these two it is grey (in - b) / (m - b).
class ColourLight {
 public:
  // `grey`: of full scale, in sRGB, that the dive's mean becomes. `encoded`: samples are sRGB already and are
  // used without linearisation.
  ColourLight(std::size_t channels, bool encoded, int bits, double grey);

  // `ratio`: a node's mean in one image over that expected of perpendicular ground; `expected`: that mean in
  // the uncorrected image [parts of full scale]. `ground`: null where ranges are not known.
  void learn(std::size_t channel, float expected, float ratio, const RangeLattice::Ground* ground);
  // `contrast`: spread over mean that the ground has on average, of the mean channel.
  void solve(float contrast);
  // What was learnt counts half from here on.
  void halve();

  // The factor of samples for a factor of light: in sRGB about its 2.2th root.
  [[nodiscard]] float samplesFor(double light) const;
  [[nodiscard]] float lit(const RangeLattice::Ground& ground) const { return tilt_.at(ground); }
  // From a sample to linear light (0 to 1) or, of encoded samples, to levels (0 to 255). `model`: the
  // channel's; `brightness`: of the image's light over the usual; `slope`: of the ground's, by lit(); `fall`:
  // light that comes back from that range over what the model says.
  [[nodiscard]] Correction correction(std::size_t channel, const ChannelModel& model, const Level& level,
                                      float brightness, float slope, float fall) const;

  [[nodiscard]] const TiltResponse& tilt() const { return tilt_; }
  [[nodiscard]] float pedestal(std::size_t channel) const { return pedestals_[channel].level(); }

  // For saved state (state_archive.hpp).
  static void exchange(auto& archive, auto& self) {
    archive(self.tilt_, self.lift_);
    archive.fixed(self.pedestals_);
  }

 private:
  bool encoded_;
  float full_, light_;
  float lift_ = 1;
  TiltResponse tilt_;
  std::vector<Pedestal> pedestals_;  // by channel
};

}  // namespace fathom::lighting
