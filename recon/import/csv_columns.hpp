#pragma once

#include <cctype>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fathom::topside {

// The letters and digits of a name in a file, in lower case: "Dist_Coeffs 1" and "distCoeffs1" are the same.
[[nodiscard]] inline std::string plainName(const std::string& name) {
  std::string out;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

// A table of text with a line of column names, as spreadsheets write it: comma, semicolon or tab between.
class CsvColumns {
 public:
  // Throws InputError for a file that is absent, empty or no table.
  explicit CsvColumns(const std::filesystem::path& path);

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  // By name, whatever its case.
  [[nodiscard]] std::optional<std::size_t> column(const std::string& name) const;
  [[nodiscard]] std::size_t required(const std::string& name) const;  // throws InputError
  [[nodiscard]] const std::string& text(std::size_t row, std::size_t column) const {
    return rows_[row][column];
  }
  // None: empty, or not finite. Throws InputError for what is no number.
  [[nodiscard]] std::optional<double> number(std::size_t row, std::size_t column) const;
  // A number of `unit` [ns], in ns.
  [[nodiscard]] std::int64_t time(std::size_t row, std::size_t column, double unit) const;
  // UTC [ns], as date and time of day (with its offset from UTC, if it says one), as Unix time, or as seconds
  // of any clock. Throws InputError.
  [[nodiscard]] std::int64_t time(std::size_t row, std::size_t column) const;
  // The first two of these forms; none: neither.
  [[nodiscard]] static std::optional<std::int64_t> timeOf(const std::string& text);
  // Throws InputError with the row's place.
  [[noreturn]] void fail(std::size_t row, const std::string& what) const;

 private:
  std::filesystem::path path_;
  std::vector<std::string> names_;
  std::vector<std::vector<std::string>> rows_;
};

}  // namespace fathom::topside
