#include "sim/scenario/random.hpp"

#include <cmath>
#include <numbers>

namespace fathom::sim {

std::uint64_t streamSeed(std::uint64_t scenario_seed, std::string_view stream) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : stream) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  std::uint64_t z = scenario_seed + hash + 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

double Random::uniform() {
  return static_cast<double>(engine_() >> 11) * 0x1.0p-53;
}

double Random::gauss() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  const double angle = 2.0 * std::numbers::pi * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

SmoothNoise::SmoothNoise(Random& random, double sigma, double shortest_period_s, double longest_period_s,
                         int terms) {
  for (int i = 0; i < terms; ++i) {
    const double fraction = (i + random.uniform()) / terms;
    const double period = shortest_period_s * std::pow(longest_period_s / shortest_period_s, fraction);
    terms_.push_back({sigma * std::sqrt(2.0 / terms), 2.0 * std::numbers::pi / period,
                      random.uniform(0.0, 2.0 * std::numbers::pi)});
  }
}

double SmoothNoise::at(double time_s) const {
  double value = 0;
  for (const Term& term : terms_) value += term.amplitude * std::sin(term.rate * time_s + term.phase);
  return value;
}

}  // namespace fathom::sim
