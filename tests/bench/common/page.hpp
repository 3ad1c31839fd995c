#pragma once

#include <filesystem>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "telemetry/web/report_page.hpp"

namespace fathom::bench {

// A text, or a number that a column shows with its digits; a number that is not finite is none.
using Cell = std::variant<std::string, double>;
template <typename Number>
requires std::is_arithmetic_v<Number>
[[nodiscard]] Cell cell(Number value) {
  return static_cast<double>(value);
}

// Figures in rows of named columns. A column's name holds its unit: "rms [mm]".
struct Table {
  struct Column {
    std::string name;
    int digits = 0;
  };
  std::string name;
  std::vector<Column> columns;
  std::vector<std::vector<Cell>> rows;

  [[nodiscard]] std::string text() const;
};

// Results of a report: printed, and written as an HTML page with drawings and as JSON with the same tables.
class Page {
 public:
  explicit Page(const std::string& title) : title_(title), report_(title, "") {}

  void add(Table table);
  // The HTML page, for words, plots and pictures.
  [[nodiscard]] web::ReportPage& report() { return report_; }
  // The tables, one after the other.
  [[nodiscard]] std::string text() const;
  // An array of the tables, each an array of objects by the names of its columns.
  [[nodiscard]] std::string json() const;
  // Writes `name`.html and `name`.json.
  void write(const std::filesystem::path& folder, const std::string& name) const;

 private:
  std::string title_;
  web::ReportPage report_;
  std::vector<Table> tables_;
};

}  // namespace fathom::bench
