#pragma once

#include <string>
#include <vector>

#include "sim/scenario/keys.hpp"

namespace fathom::sim {

// Throws std::invalid_argument("<table>: <what>") unless `good`.
void requireSetting(bool good, const char* table, const char* what);

// Checks a configuration that a program has set against the ranges of the scenario's keys. Throws
// std::invalid_argument that names the key and its range.
class KeyRangeCheck final : public KeyVisitor {
 public:
  void enter(const char* table, const char* meaning) override;
  void leave() override;
  std::size_t beginList(const char* key, std::size_t count, const char* meaning) override;
  void enterItem(std::size_t) override {}
  void leaveItem() override {}
  void endList() override { leave(); }

  void number(const char* key, double& value, const char* unit, double low, double high,
              const char* meaning) override;
  void angle(const char* key, double& value, double low_deg, double high_deg, const char* meaning) override;
  void integer(const char* key, std::int64_t& value, std::int64_t low, std::int64_t high,
               const char* meaning) override;
  void utc(const char*, std::int64_t&, const char*) override {}
  void text(const char*, std::string&, const char*) override {}
  void choice(const char* key, std::size_t& value, std::span<const char* const> names,
              const char* meaning) override;
  void vector3(const char* key, Eigen::Vector3d& value, const char* unit, double low, double high,
               const char* meaning) override;

 private:
  void requireRange(bool good, const char* key, double low, double high) const;
  std::vector<std::string> tables_;
};

}  // namespace fathom::sim
