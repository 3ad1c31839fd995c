#pragma once

#include <string>
#include <vector>

#include "realtime/base/config_keys.hpp"

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
  void angle(const char* key, double& value, const char* unit, double low_deg, double high_deg,
             const char* meaning) override;
  void integer(const char* key, std::int64_t& value, const char* unit, std::int64_t low, std::int64_t high,
               const char* meaning) override;
  void boolean(const char*, bool&, const char*) override {}
  void utc(const char*, std::int64_t&, const char*) override {}
  void text(const char*, std::string&, const char*) override {}
  void choice(const char* key, std::size_t& value, std::span<const char* const> names,
              const char* meaning) override;
  void numbers(const char* key, std::span<double> values, const char* unit, double low, double high,
               const char* meaning) override;
  void integers(const char* key, std::vector<int>& values, int low, int high, const char* meaning) override;

 private:
  void requireRange(bool good, const char* key, double low, double high) const;
  std::vector<std::string> tables_;
};

}  // namespace fathom::sim
