#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "realtime/base/config_table.hpp"

namespace fathom {

// Visitor of every key of a configuration; readers, writers and range checks implement it. A key's name,
// unit, range and meaning are defined in one place, the function that visits the keys of a structure, and its
// default is the member's initial value.
class KeyVisitor {
 public:
  virtual ~KeyVisitor() = default;

  virtual void enter(const char* table, const char* meaning) = 0;
  virtual void leave() = 0;
  // Begins the tables of [[key]]: is given their present count and returns the new one; enterItem() and
  // leaveItem() are called for each, then endList().
  virtual std::size_t beginList(const char* key, std::size_t count, const char* meaning) = 0;
  virtual void enterItem(std::size_t index) = 0;
  virtual void leaveItem() = 0;
  virtual void endList() = 0;

  virtual void number(const char* key, double& value, const char* unit, double low, double high,
                      const char* meaning) = 0;
  // `value` in rad; the file holds degrees, and so do the limits. `unit`: the one that the file is documented
  // with.
  virtual void angle(const char* key, double& value, const char* unit, double low_deg, double high_deg,
                     const char* meaning) = 0;
  virtual void integer(const char* key, std::int64_t& value, const char* unit, std::int64_t low,
                       std::int64_t high, const char* meaning) = 0;
  virtual void boolean(const char* key, bool& value, const char* meaning) = 0;
  // An ISO 8601 date and time in UTC; `value` in ns since the Unix epoch.
  virtual void utc(const char* key, std::int64_t& value, const char* meaning) = 0;
  virtual void text(const char* key, std::string& value, const char* meaning) = 0;
  // `value` is the index of one of `names`.
  virtual void choice(const char* key, std::size_t& value, std::span<const char* const> names,
                      const char* meaning) = 0;
  // An array of as many numbers as `values` has.
  virtual void numbers(const char* key, std::span<double> values, const char* unit, double low, double high,
                       const char* meaning) = 0;
  // An array of any length.
  virtual void integers(const char* key, std::vector<int>& values, int low, int high,
                        const char* meaning) = 0;

  // True for readers: the visit must then set values that follow from others.
  [[nodiscard]] virtual bool reads() const { return false; }
  // If `good` is false, a reader throws the InputError of this key of the present table; others ignore it.
  virtual void require(bool good, const char* key, const std::string& fix) const;

  // Overloads for other types of values.
  void angle(const char* key, double& value, double low_deg, double high_deg, const char* meaning) {
    angle(key, value, "deg", low_deg, high_deg, meaning);
  }
  template <std::integral T>
  requires(!std::same_as<T, bool>) void integer(const char* key, T& value, const char* unit, std::int64_t low,
                                                std::int64_t high, const char* meaning) {
    auto wide = static_cast<std::int64_t>(value);
    integer(key, wide, unit, low, high, meaning);
    value = static_cast<T>(wide);
  }
  template <std::integral T>
  void integer(const char* key, T& value, std::int64_t low, std::int64_t high, const char* meaning) {
    integer(key, value, "", low, high, meaning);
  }
  // Absent is -1 in the file.
  template <std::integral T>
  void optionalInteger(const char* key, std::optional<T>& value, std::int64_t high, const char* meaning) {
    std::int64_t wide = value ? static_cast<std::int64_t>(*value) : -1;
    integer(key, wide, "", -1, high, meaning);
    value = wide < 0 ? std::nullopt : std::optional(static_cast<T>(wide));
  }
  // Absent is 0 in the file.
  void optionalNumber(const char* key, std::optional<double>& value, const char* unit, double high,
                      const char* meaning);
  // `value` is the file's number times `step`: bytes for a file in MiB, ns for ms.
  template <std::integral T>
  void scaled(const char* key, T& value, std::int64_t step, const char* unit, std::int64_t low,
              std::int64_t high, const char* meaning) {
    std::int64_t whole = static_cast<std::int64_t>(value) / step;
    integer(key, whole, unit, low, high, meaning);
    value = static_cast<T>(whole * step);
  }
  // The same for a number with a fraction.
  void scaledNumber(const char* key, std::int64_t& value, std::int64_t step, const char* unit, double low,
                    double high, const char* meaning);
  void vector3(const char* key, std::array<double, 3>& value, const char* unit, double low, double high,
               const char* meaning) {
    numbers(key, value, unit, low, high, meaning);
  }
  // Overload for Eigen's vectors.
  template <typename Vector>
  void vector3(const char* key, Vector& value, const char* unit, double low, double high,
               const char* meaning) {
    numbers(key, std::span<double>(value.data(), 3), unit, low, high, meaning);
  }
  // `value`: enumerators, or false and true, in the order of `names`.
  template <typename Enum>
  void choiceOf(const char* key, Enum& value, std::span<const char* const> names, const char* meaning) {
    auto index = static_cast<std::size_t>(value);
    choice(key, index, names, meaning);
    value = static_cast<Enum>(index);
  }
  // `value` is one of `names` itself.
  void choiceText(const char* key, std::string& value, std::span<const char* const> names,
                  const char* meaning);
  // The tables of [[key]]: visit(item) is called for each. A file's tables beyond `most` are refused by
  // finish().
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
  // A sub-table: its keys are visited by visit().
  template <typename Visit>
  void table(const char* key, const char* meaning, Visit visit) {
    enter(key, meaning);
    visit();
    leave();
  }
};

// Replaces values by those of a TOML table; what it lacks keeps its value. Every failure is an InputError
// that names file, line, key and fix.
class ConfigReader final : public KeyVisitor {
 public:
  explicit ConfigReader(ConfigTable top) { tables_.push_back(std::move(top)); }
  // Throws for a key that no visit asked for.
  void finish() const { tables_.front().finish(); }

  void enter(const char* table, const char*) override { tables_.push_back(top().table(table)); }
  void leave() override { tables_.pop_back(); }
  std::size_t beginList(const char* key, std::size_t count, const char*) override;
  void enterItem(std::size_t index) override;
  void leaveItem() override { tables_.pop_back(); }
  void endList() override { lists_.pop_back(); }
  void number(const char* key, double& value, const char*, double low, double high, const char*) override {
    value = top().number(key, value, low, high);
  }
  void angle(const char* key, double& value, const char*, double low_deg, double high_deg,
             const char*) override;
  void integer(const char* key, std::int64_t& value, const char*, std::int64_t low, std::int64_t high,
               const char*) override {
    value = top().integer(key, value, low, high);
  }
  void boolean(const char* key, bool& value, const char*) override { value = top().boolean(key, value); }
  void utc(const char* key, std::int64_t& value, const char*) override {
    if (top().has(key)) value = top().requiredUtc(key);
  }
  void text(const char* key, std::string& value, const char*) override { value = top().text(key, value); }
  void choice(const char* key, std::size_t& value, std::span<const char* const> names, const char*) override;
  void numbers(const char* key, std::span<double> values, const char*, double low, double high,
               const char*) override;
  void integers(const char* key, std::vector<int>& values, int low, int high, const char*) override;
  [[nodiscard]] bool reads() const override { return true; }
  void require(bool good, const char* key, const std::string& fix) const override;

 private:
  [[nodiscard]] const ConfigTable& top() const { return tables_.back(); }

  std::vector<ConfigTable> tables_;
  std::vector<std::optional<std::vector<ConfigTable>>> lists_;  // nullopt: not in the file
};

// Lists every key that it visits.
class ConfigListing final : public KeyVisitor {
 public:
  // `defaults`: the listing of the default configuration, for the word "default" of each line.
  explicit ConfigListing(const ConfigListing* defaults = nullptr) : defaults_(defaults) {}

  // TOML of one line per key, with its value, unit, range, default and meaning. Reading it gives the same
  // configuration.
  [[nodiscard]] const std::string& toml() const { return toml_; }
  struct Row {
    std::string key, value, unit, range, meaning;  // `key` with its tables, as "link.rate_bps"
  };
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }

  void enter(const char* table, const char* meaning) override;
  void leave() override { path_.pop_back(); }
  std::size_t beginList(const char* key, std::size_t count, const char* meaning) override;
  void enterItem(std::size_t index) override;
  void leaveItem() override { path_.back().resize(path_.back().find('#')); }
  void endList() override { path_.pop_back(); }
  void number(const char* key, double& value, const char* unit, double low, double high,
              const char* meaning) override;
  void angle(const char* key, double& value, const char* unit, double low_deg, double high_deg,
             const char* meaning) override;
  void integer(const char* key, std::int64_t& value, const char* unit, std::int64_t low, std::int64_t high,
               const char* meaning) override;
  void boolean(const char* key, bool& value, const char* meaning) override;
  void utc(const char* key, std::int64_t& value, const char* meaning) override;
  void text(const char* key, std::string& value, const char* meaning) override;
  void choice(const char* key, std::size_t& value, std::span<const char* const> names,
              const char* meaning) override;
  void numbers(const char* key, std::span<double> values, const char* unit, double low, double high,
               const char* meaning) override;
  void integers(const char* key, std::vector<int>& values, int low, int high, const char* meaning) override;

 private:
  [[nodiscard]] std::string name() const;
  void line(const char* key, const std::string& value, const std::string& unit, const std::string& range,
            const char* meaning);

  const ConfigListing* defaults_;
  std::vector<std::string> path_;
  std::vector<Row> rows_;
  std::map<std::string, std::string> values_;
  std::string toml_;
};

// `config` with the values of a table over its own. Keys that `visit` does not ask for are left for the
// caller's finish().
template <typename Config, typename Visit>
Config readKeys(const ConfigTable& table, Config config, Visit visit) {
  ConfigReader keys(table);
  visit(keys, config);
  return config;
}

// A configuration's keys as TOML with their defaults. `visit(KeyVisitor&, Config&)`.
template <typename Config, typename Visit>
std::string configToml(const Config& config, const Config& defaults, Visit visit) {
  Config untouched = defaults, shown = config;
  ConfigListing of_defaults;
  visit(of_defaults, untouched);
  ConfigListing listing(&of_defaults);
  visit(listing, shown);
  return listing.toml();
}

// A double in TOML, the shortest decimal that reads back to the same bits.
[[nodiscard]] std::string tomlNumber(double value);
// A basic string with its quotes, every character that TOML would misread escaped.
[[nodiscard]] std::string tomlString(const std::string& text);

}  // namespace fathom
