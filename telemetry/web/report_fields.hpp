#pragma once

#include <Eigen/Core>
#include <concepts>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "realtime/base/text.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::web {

// A figure of a report, described once for both of its forms: in the JSON file a value by its key, on the
// page a row of a title, with the unit, and the value as it is shown there. Without a key it is on the page
// alone, without a title in the file alone.
struct ReportField {
  using Json = nlohmann::ordered_json;
  ReportField(std::string in_file, Json of_file) : key(std::move(in_file)), value(std::move(of_file)) {}
  // Words and whole numbers, shown as they are.
  ReportField(std::string in_file, Json of_file, std::string on_page)
      : ReportField(std::move(in_file), std::move(of_file)) {
    title = std::move(on_page);
    shown = value.is_string() ? value.get<std::string>() : value.dump();
  }
  ReportField(std::string in_file, Json of_file, std::string on_page, std::string words)
      : key(std::move(in_file)),
        value(std::move(of_file)),
        title(std::move(on_page)),
        shown(std::move(words)) {}
  // A number in the key's unit, `times` of which make the title's.
  ReportField(std::string in_file, std::same_as<double> auto number, std::string on_page, int digits,
              double times = 1)
      : ReportField(std::move(in_file), Json(number), std::move(on_page), decimals(times * number, digits)) {}
  // A group: an object of the file (null without fields), and its rows among the others.
  ReportField(std::string in_file, std::vector<ReportField> of_group)
      : key(std::move(in_file)), group(std::move(of_group)) {}

  std::string key;
  Json value;
  std::string title, shown;
  std::vector<ReportField> group;
};
using Fields = std::vector<ReportField>;

// What is on the page alone.
[[nodiscard]] inline ReportField onPage(std::string title, std::string words) {
  return {"", nullptr, std::move(title), std::move(words)};
}
// The fields after a first one on the page: what in the file is an object's key, or not said.
[[nodiscard]] inline Fields named(std::string title, std::string words, Fields fields) {
  fields.insert(fields.begin(), onPage(std::move(title), std::move(words)));
  return fields;
}

[[nodiscard]] inline ReportField::Json jsonOf(const Fields& fields) {
  ReportField::Json out;
  for (const ReportField& f : fields)
    if (!f.key.empty()) out[f.key] = f.group.empty() ? f.value : jsonOf(f.group);
  return out;
}
[[nodiscard]] inline ReportField::Json jsonOf(const std::vector<Fields>& records) {
  ReportField::Json out = ReportField::Json::array();
  for (const Fields& record : records) out.push_back(jsonOf(record));
  return out;
}
// A vector as an array; in the file null stands for what is not finite.
template <typename Vector>
[[nodiscard]] ReportField::Json jsonOf(const Eigen::MatrixBase<Vector>& v) {
  ReportField::Json out = ReportField::Json::array();
  for (Eigen::Index i = 0; i < v.size(); ++i) out.push_back(v(i));
  return out;
}

// Rows of title and value, in the order of the fields.
[[nodiscard]] inline std::vector<Row> rowsOf(const Fields& fields) {
  std::vector<Row> out;
  for (const ReportField& f : fields) {
    if (!f.title.empty()) out.push_back({f.title, f.shown});
    for (Row& row : rowsOf(f.group)) out.push_back(std::move(row));
  }
  return out;
}

// A table with a row a record, under the titles of the first; nothing without records.
inline void addTable(ReportPage& report, const std::vector<Fields>& records) {
  Row head;
  std::vector<Row> rows;
  for (const Fields& record : records) {
    head.clear();
    Row& values = rows.emplace_back();
    for (Row& row : rowsOf(record)) {
      head.push_back(std::move(row[0]));
      values.push_back(std::move(row[1]));
    }
  }
  if (!rows.empty()) report.table(head, rows);
}

}  // namespace fathom::web
