#pragma once

#include <cstdint>
#include <random>
#include <string_view>
#include <vector>

namespace fathom::sim {

// Seed of one named stream of random numbers: every sensor and motion draws from its own stream, so that a
// change of one (a rate, a switch) leaves the others' numbers as they were. FNV-1a of the name, mixed with
// the scenario's seed by splitmix64 (Steele, Lea and Flood 2014).
[[nodiscard]] std::uint64_t streamSeed(std::uint64_t scenario_seed, std::string_view stream);

// Random numbers whose bits do not depend on the standard library's distributions.
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

// A smooth random function of time with infinitely many derivatives: sinusoids of equal power with random
// phases and with periods spread over a band. Standard deviation over long times is `sigma`, bounded by sigma
// * sqrt(2 * terms).
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
