#pragma once

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
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

inline std::string shown(const Cell& cell, int digits) {
  const auto* text = std::get_if<std::string>(&cell);
  return text != nullptr ? *text : decimals(std::get<double>(cell), digits);
}

inline bool isText(const Cell& cell) {
  return std::holds_alternative<std::string>(cell);
}

// Characters, not bytes.
inline std::size_t widthOf(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

inline std::string Table::text() const {
  std::vector<std::size_t> widths;
  for (const Column& column : columns) widths.push_back(widthOf(column.name));
  for (const auto& row : rows)
    for (std::size_t k = 0; k < row.size(); ++k)
      widths[k] = std::max(widths[k], widthOf(shown(row[k], columns[k].digits)));
  std::string out = name.empty() ? "" : name + "\n";
  const auto add = [&](std::size_t k, const std::string& words, bool left) {
    const bool last = left && k + 1 == columns.size();
    const std::string room(last ? 0 : widths[k] - widthOf(words), ' ');
    out += (k > 0 ? "  " : "") + (left ? words + room : room + words);
  };
  for (std::size_t k = 0; k < columns.size(); ++k)
    add(k, columns[k].name, !rows.empty() && isText(rows.front()[k]));
  for (const auto& row : rows) {
    out += "\n";
    for (std::size_t k = 0; k < row.size(); ++k) add(k, shown(row[k], columns[k].digits), isText(row[k]));
  }
  return out + "\n";
}

inline void Page::add(Table table) {
  report_.section(table.name);
  web::Row head;
  for (const Table::Column& column : table.columns) head.emplace_back(column.name);
  std::vector<web::Row> rows;
  for (const auto& row : table.rows) {
    rows.emplace_back();
    for (std::size_t k = 0; k < row.size(); ++k)
      rows.back().emplace_back(shown(row[k], table.columns[k].digits));
  }
  report_.table(head, rows);
  tables_.push_back(std::move(table));
}

inline std::string Page::text() const {
  std::string out;
  for (const Table& table : tables_) out += (out.empty() ? "" : "\n") + table.text();
  return out;
}

inline std::string Page::json() const {
  using Json = nlohmann::ordered_json;
  Json tables = Json::array();
  for (const Table& table : tables_) {
    Json rows = Json::array();
    for (const auto& row : table.rows) {
      Json object;
      for (std::size_t k = 0; k < row.size(); ++k)
        std::visit([&](const auto& value) { object[table.columns[k].name] = value; }, row[k]);
      rows.push_back(std::move(object));
    }
    tables.push_back({{"name", table.name}, {"rows", std::move(rows)}});
  }
  return Json{{"title", title_}, {"tables", std::move(tables)}}.dump(2) + "\n";
}

inline void Page::write(const std::filesystem::path& folder, const std::string& name) const {
  std::filesystem::create_directories(folder);
  report_.write(folder / (name + ".html"));
  writeFile(folder / (name + ".json"), json());
}

}  // namespace fathom::bench
