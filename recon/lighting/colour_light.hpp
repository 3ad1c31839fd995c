#pragma once

#include <vector>

#include "recon/lighting/channel_model.hpp"
#include "recon/lighting/correct_rows.hpp"
#include "recon/lighting/pedestal.hpp"
#include "recon/lighting/range_lattice.hpp"
#include "recon/lighting/tilt_response.hpp"

namespace fathom::lighting {

// What colours need to know beyond the mean that ChannelModel expects of a place in the image and a range:
// how light answers to the ground's slope, and what each channel reads without any light from the ground. A
// colour is then the albedo over the dive's mean of it, in linear light:
//   light = grey (1 + lift (in - m) / (m - b)),   m: mean expected there, times the slope's answer
// which is grey (in - b) / (m - b) where nothing is lifted.
class ColourLight {
 public:
  // `grey`: of full scale, in sRGB, that the dive's mean becomes. `encoded`: samples are sRGB already, as
  // cameras write pictures for people, and colours are made of them as they are.
  ColourLight(std::size_t channels, bool encoded, int bits, double grey);

  // A node's mean in one image over the mean expected there of square ground; `expected` is that in the image
  // as it came [parts of full scale]. `ground`: null where ranges are not known.
  void learn(std::size_t channel, float expected, float ratio, const RangeLattice::Ground* ground);
  // `contrast`: spread over mean that the ground has on average, of the mean channel.
  void solve(float contrast);
  // What was learnt counts half from here on.
  void halve();

  // By how much samples change when light does: of sRGB by about its 2.2th root.
  [[nodiscard]] float samplesFor(double light) const;
  [[nodiscard]] float lit(const RangeLattice::Ground& ground) const { return tilt_.at(ground); }
  // From a sample to linear light (0 to 1) or, of encoded samples, to levels (0 to 255). `brightness`: of the
  // image's samples and of the slope.
  [[nodiscard]] Correction correction(std::size_t channel, const Level& level, float brightness) const;

  [[nodiscard]] const TiltResponse& tilt() const { return tilt_; }
  [[nodiscard]] float pedestal(std::size_t channel) const { return pedestals_[channel].level(); }

  // For saved state (state_archive.hpp).
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
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
