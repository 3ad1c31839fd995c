#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace fathom::io {

// A TOML file read strictly: each key is asked for with its type and range, and finish() refuses the keys
// that nobody asked for. Every refusal is an InputError that names file, key, line and mend.
//
//   const TomlTable top = TomlTable::read(path, "a mission.toml");
//   config.rate_hz = top.table("cameras").number("rate_hz", 0.001, 1000.0);
//   top.finish();
class TomlTable {
 public:
  // `what` says what the file should be, for the line about an absent or empty one.
  [[nodiscard]] static TomlTable read(const std::filesystem::path& path, const char* what);
  // The same from text; `path` only names it.
  [[nodiscard]] static TomlTable parse(const std::filesystem::path& path, const std::string& text);

  // Values with a default may be absent; the others must be there. Ranges include their ends. Numbers may be
  // written as integers; nan and inf are out of every range.
  [[nodiscard]] double number(const char* key, double min, double max,
                              std::optional<double> absent = {}) const;
  [[nodiscard]] std::int64_t integer(const char* key, std::int64_t min, std::int64_t max,
                                     std::optional<std::int64_t> absent = {}) const;
  [[nodiscard]] bool flag(const char* key, std::optional<bool> absent = {}) const;
  [[nodiscard]] std::string text(const char* key, const std::optional<std::string>& absent = {}) const;
  // The index of the text among `names`.
  [[nodiscard]] std::size_t choice(const char* key, std::initializer_list<const char*> names) const;
  // Three numbers, as [x, y, z].
  [[nodiscard]] Eigen::Vector3d vector3(const char* key, double min, double max) const;
  // An ISO 8601 date and time in UTC ("2026-03-01T02:03:04.5Z"): ns since the Unix epoch.
  [[nodiscard]] std::int64_t utc(const char* key) const;

  // A table inside; an absent one is refused, or, with tableOr, taken as empty.
  [[nodiscard]] TomlTable table(const char* key) const;
  [[nodiscard]] TomlTable tableOr(const char* key) const;
  // The tables of [[key]], in the file's order; none if absent.
  [[nodiscard]] std::vector<TomlTable> tables(const char* key) const;
  [[nodiscard]] bool has(const char* key) const;

  // Refuses a key, of this table or of one taken from it, that was never asked for.
  void finish() const;
  // An error about `key`, for a check that only the caller can make.
  [[noreturn]] void fail(const std::string& key, const std::string& mend) const;

 private:
  struct File;
  struct State;
  TomlTable(std::shared_ptr<File> file, std::shared_ptr<State> state)
      : file_(std::move(file)), state_(std::move(state)) {}

  std::shared_ptr<File> file_;
  std::shared_ptr<State> state_;
};

// A double in TOML, the shortest decimal that reads back to the same bits.
[[nodiscard]] std::string tomlNumber(double value);
// A basic string with its quotes, every character that TOML would misread escaped.
[[nodiscard]] std::string tomlString(const std::string& text);

}  // namespace fathom::io
