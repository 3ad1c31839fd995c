#pragma once

namespace fathom::nav {

// Depth of a body from a pressure sensor p, which swell disturbs, and the DVL's vertical velocity w, which
// swell does not disturb but which drifts when it is summed up: a complementary filter of second order
// (Mahony, Hamel & Pflimlin 2008, the linear case),
//   dz/dt = w + u,   du/dt = omega^2 (p - z) - sqrt(2) omega u,
// so that of swell of the rate s a share (omega / s)^2 is left, and a velocity that is wrong by b leaves
// sqrt(2) b / omega. z and dz/dt never jump. omega follows the swell that is seen: the standard deviation of
// p less the sum of w without what is slower than half a minute, over the last minute. Fixed memory; works in
// steps of any length (backward Euler).
class DepthFilter {
 public:
  void start(double pressure_depth) noexcept;
  // `seconds` later [s], `moved` down by the DVL [m]; then the depth by pressure [m].
  void add(double seconds, double moved, double pressure_depth) noexcept;
  // Without DVL, `moved` being a guess: pressure, nearly at once.
  void addWithoutVelocity(double seconds, double moved, double pressure_depth) noexcept;
  void addWithoutPressure(double moved) noexcept;

  [[nodiscard]] double depth() const noexcept { return depth_; }  // z [m]
  // Pressure's newest depth less z; 0 without pressure [m].
  [[nodiscard]] double pressureOff() const noexcept { return silent_ ? 0 : pressure_ - depth_; }
  // Standard deviation that swell gives a depth by pressure, as seen; 0 in a calm sea [m].
  [[nodiscard]] double sigma() const noexcept;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.depth_, self.rate_, self.pressure_, self.silent_, self.fast_, self.faster_, self.variance_,
            self.learnt_s_);
  }

 private:
  void learn(double seconds, double change) noexcept;
  void follow(double omega, double seconds, double moved, double pressure_depth) noexcept;

  double depth_ = 0, rate_ = 0;   // z [m], u [m/s]
  double pressure_ = 0;           // newest depth by pressure [m]
  bool silent_ = false;           // there was none since
  double fast_ = 0, faster_ = 0;  // pressure less the velocity's sum, high-pass filtered once, twice [m]
  double variance_ = 0, learnt_s_ = 0;  // of the latter [m^2]; over so long [s]
};

}  // namespace fathom::nav
