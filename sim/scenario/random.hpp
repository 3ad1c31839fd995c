#pragma once

#include <cstdint>
#include <random>
#include <string_view>
#include <vector>

namespace fathom::sim {

// Seed of a named random stream. Every sensor and motion has its own stream, so that changing one leaves the
// numbers of the others unchanged. FNV-1a of the name, mixed with the scenario's seed by splitmix64 (Steele,
// Lea and Flood 2014).
[[nodiscard]] std::uint64_t streamSeed(std::uint64_t scenario_seed, std::string_view stream);

// Random numbers that are equal on every standard library: none of its distributions is used.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  Random(std::uint64_t scenario_seed, std::string_view stream) : Random(streamSeed(scenario_seed, stream)) {}

  double uniform();  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double gauss();  // zero mean, unit variance (Box-Muller)
  double gauss(double sigma) { return sigma * gauss(); }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0;
  bool has_spare_ = false;
};

// A smooth random function of time: a sum of sinusoids of equal power with random phases and with periods
// spread over a band. Its standard deviation over long times is `sigma`; |value| <= sigma * sqrt(2 * terms).
class SmoothNoise {
 public:
  SmoothNoise() = default;
  SmoothNoise(Random& random, double sigma, double shortest_period_s, double longest_period_s, int terms = 5);
  [[nodiscard]] double at(double time_s) const;

 private:
  struct Term {
    double amplitude, rate, phase;  // value's unit, [rad/s], [rad]
  };
  std::vector<Term> terms_;
};

}  // namespace fathom::sim
