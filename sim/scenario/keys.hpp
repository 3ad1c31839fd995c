#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace fathom::sim {

// Visitor of every key of a scenario; readers, writers and range checks implement it. A key's name, unit,
// range and meaning are defined in one place, and its default is the member's initial value.
class KeyVisitor {
 public:
  virtual ~KeyVisitor() = default;

  virtual void enter(const char* table, const char* meaning) = 0;
  virtual void leave() = 0;
  // The tables of [[key]]: takes their present count and gives the new one; enterItem() follows for each.
  virtual std::size_t beginList(const char* key, std::size_t count, const char* meaning) = 0;
  virtual void enterItem(std::size_t index) = 0;
  virtual void leaveItem() = 0;
  virtual void endList() = 0;

  virtual void number(const char* key, double& value, const char* unit, double low, double high,
                      const char* meaning) = 0;
  // `value` in rad; the file holds degrees, and so do the limits.
  virtual void angle(const char* key, double& value, double low_deg, double high_deg,
                     const char* meaning) = 0;
  virtual void integer(const char* key, std::int64_t& value, std::int64_t low, std::int64_t high,
                       const char* meaning) = 0;
  // An ISO 8601 date and time in UTC; `value` in ns since the Unix epoch.
  virtual void utc(const char* key, std::int64_t& value, const char* meaning) = 0;
  virtual void text(const char* key, std::string& value, const char* meaning) = 0;
  // `value` is the index of one of `names`.
  virtual void choice(const char* key, std::size_t& value, std::span<const char* const> names,
                      const char* meaning) = 0;
  virtual void vector3(const char* key, Eigen::Vector3d& value, const char* unit, double low, double high,
                       const char* meaning) = 0;

  // Overloads for other types of values.
  void integer(const char* key, int& value, int low, int high, const char* meaning) {
    std::int64_t wide = value;
    integer(key, wide, static_cast<std::int64_t>(low), static_cast<std::int64_t>(high), meaning);
    value = static_cast<int>(wide);
  }
  void vector3(const char* key, std::array<double, 3>& value, const char* unit, double low, double high,
               const char* meaning) {
    Eigen::Vector3d v(value[0], value[1], value[2]);
    vector3(key, v, unit, low, high, meaning);
    value = {v.x(), v.y(), v.z()};
  }
  template <typename Enum>
  void choiceOf(const char* key, Enum& value, std::span<const char* const> names, const char* meaning) {
    auto index = static_cast<std::size_t>(value);
    choice(key, index, names, meaning);
    value = static_cast<Enum>(index);
  }
  // The tables of [[key]], at most `most`: visit(item) of each.
  template <typename Item, typename Visit>
  void listOf(const char* key, std::vector<Item>& items, std::size_t most, const char* meaning, Visit visit) {
    items.resize(std::min(beginList(key, items.size(), meaning), most));
    for (std::size_t i = 0; i < items.size(); ++i) {
      enterItem(i);
      visit(items[i]);
      leaveItem();
    }
    endList();
  }
};

}  // namespace fathom::sim
