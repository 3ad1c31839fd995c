#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <random>
#include <span>
#include <vector>

namespace fathom::test {

// One direction of the water: loses frames in bursts, doubles, delays and damages them.
struct SeaWeather {
  double loss = 0, burst = 1;       // share of frames; mean length of a burst
  double doubled = 0, damaged = 0;  // shares
  double late = 0, late_s = 0;      // share, and by up to so long
  double sound_s = 0.3;             // of the way
};

class Sea {
 public:
  Sea(const SeaWeather& weather, unsigned seed) : weather_(weather), random_(seed) {}
  void calm() { weather_ = {0, 1, 0, 0, 0, 0, weather_.sound_s}; }
  // A frame whose last bit leaves then.
  void send(std::int64_t left_ns, std::span<const std::uint8_t> frame);
  // Gives what has arrived by now.
  void receive(std::int64_t now_ns, const std::function<void(std::span<const std::uint8_t>)>& take);

 private:
  [[nodiscard]] double draw() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  SeaWeather weather_;
  std::mt19937 random_;
  bool fading_ = false;
  std::multimap<std::int64_t, std::vector<std::uint8_t>> under_way_;
};

}  // namespace fathom::test
