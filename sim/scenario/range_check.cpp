#include "sim/scenario/range_check.hpp"

#include <stdexcept>

#include "realtime/kernel/text.hpp"
#include "sim/scenario/degrees.hpp"

namespace fathom::sim {

void RangeCheck::enter(const char* table, const char*) {
  tables_.emplace_back(table);
}
void RangeCheck::leave() {
  tables_.pop_back();
}
std::size_t RangeCheck::beginList(const char* key, std::size_t count, const char*) {
  tables_.emplace_back(key);
  return count;
}

void RangeCheck::require(bool good, const char* key, double low, double high) const {
  if (good) return;
  std::string name;
  for (const std::string& table : tables_) name += table + ".";
  throw std::invalid_argument(name + key + " must be " + formatted("%g to %g", low, high));
}

void RangeCheck::number(const char* key, double& value, const char*, double low, double high, const char*) {
  require(value >= low && value <= high, key, low, high);
}
void RangeCheck::angle(const char* key, double& value, double low_deg, double high_deg, const char*) {
  constexpr double kRounded = 1e-9;  // degrees in radians and back
  const double in_degrees = value / degrees(1);
  require(in_degrees >= low_deg - kRounded && in_degrees <= high_deg + kRounded, key, low_deg, high_deg);
}
void RangeCheck::integer(const char* key, std::int64_t& value, std::int64_t low, std::int64_t high,
                         const char*) {
  require(value >= low && value <= high, key, static_cast<double>(low), static_cast<double>(high));
}
void RangeCheck::choice(const char* key, std::size_t& value, std::span<const char* const> names,
                        const char*) {
  require(value < names.size(), key, 0, static_cast<double>(names.size()) - 1);
}
void RangeCheck::vector3(const char* key, Eigen::Vector3d& value, const char*, double low, double high,
                         const char*) {
  require(value.allFinite() && value.minCoeff() >= low && value.maxCoeff() <= high, key, low, high);
}

}  // namespace fathom::sim
