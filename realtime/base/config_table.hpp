#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace fathom {

// One table of a TOML file, read key by key with bounds. Every failure is an InputError that names the file,
// the line, the key and the remedy. finish() refuses keys of this table and its sub-tables that were never
// read, so that a misspelt key is an error.
class ConfigTable {
 public:
  // Reads a file; an absent or malformed one is an InputError. An empty file is an empty table.
  [[nodiscard]] static ConfigTable load(const std::filesystem::path& path);
  // The same from text; `name` stands for the file in error lines.
  [[nodiscard]] static ConfigTable parse(std::string_view text, const std::string& name);

  ConfigTable(const ConfigTable& other);  // the same table of the same file
  ConfigTable(ConfigTable&&) noexcept;
  ConfigTable& operator=(ConfigTable&&) noexcept;
  ~ConfigTable();

  [[nodiscard]] bool has(std::string_view key) const;

  // Values with a default; an integer is accepted as a number. Bounds are inclusive; a value that is not
  // finite is refused.
  [[nodiscard]] double number(std::string_view key, double fallback, double min, double max) const;
  [[nodiscard]] std::int64_t integer(std::string_view key, std::int64_t fallback, std::int64_t min,
                                     std::int64_t max) const;
  [[nodiscard]] bool boolean(std::string_view key, bool fallback) const;
  [[nodiscard]] std::string text(std::string_view key, std::string_view fallback) const;
  // One of a list of words.
  [[nodiscard]] std::string choice(std::string_view key, std::string_view fallback,
                                   const std::vector<std::string>& allowed) const;
  // An array of exactly `count` numbers (0: any count), each within the bounds.
  [[nodiscard]] std::vector<double> numbers(std::string_view key, const std::vector<double>& fallback,
                                            std::size_t count, double min, double max) const;

  // The same for keys that must be there.
  [[nodiscard]] double requiredNumber(std::string_view key, double min, double max) const;
  [[nodiscard]] std::int64_t requiredInteger(std::string_view key, std::int64_t min, std::int64_t max) const;
  [[nodiscard]] std::string requiredText(std::string_view key) const;
  [[nodiscard]] std::vector<double> requiredNumbers(std::string_view key, std::size_t count, double min,
                                                    double max) const;
  // A TOML date and time in UTC ("2026-03-01T02:03:04.5Z"), as ns since the Unix epoch.
  [[nodiscard]] std::int64_t requiredUtc(std::string_view key) const;

  // A sub-table; an absent one is empty (its keys take their defaults).
  [[nodiscard]] ConfigTable table(std::string_view key) const;
  // An array of tables, in order; absent: none.
  [[nodiscard]] std::vector<ConfigTable> tables(std::string_view key) const;

  // InputError for the first key (in file order) of this table or below it that was never read.
  void finish() const;

  // Throws the InputError of a check that the caller makes on a key of this table.
  [[noreturn]] void fail(std::string_view key, const std::string& fix) const;

 private:
  struct Impl;
  explicit ConfigTable(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom
