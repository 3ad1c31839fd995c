#pragma once

#include <array>
#include <cstddef>

namespace fathom::lighting {

// What one channel reads where no light comes back from the ground: the sensor's black level, and haze that
// is everywhere alike. Of the same ground, contrast fades with brightness m as 1 - b / m, which is fitted to
// how much nodes differ from what is expected of them, by classes of the expected brightness. Means over
// nodes hardly know noise, which would hide the fading.
class Pedestal {
 public:
  // `expected` in parts of full scale; `ratio`: seen over expected.
  void add(float expected, float ratio);
  void solve();
  // What was added counts half from here on.
  void halve();
  [[nodiscard]] float level() const { return level_; }  // parts of full scale

  // For saved state (state_archive.hpp).
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.count_, self.expected_, self.sum_, self.squares_, self.level_);
  }

 private:
  static constexpr int kClasses =
      25;  // half octaves down from full scale, to a sixteenth of a level of 8 bits
  std::array<float, kClasses> count_{}, expected_{}, sum_{}, squares_{};
  float level_ = 0;
};

}  // namespace fathom::lighting
