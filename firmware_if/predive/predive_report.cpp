#include "firmware_if/predive/predive_report.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace fathom::io {
namespace {

const char* word(PrediveVerdict verdict) {
  switch (verdict) {
    case PrediveVerdict::kGood:
      return "good";
    case PrediveVerdict::kBad:
      return "bad";
    case PrediveVerdict::kUnused:
      break;
  }
  return "unused";
}

}  // namespace

bool PrediveReport::allGood() const {
  return std::none_of(rows.begin(), rows.end(),
                      [](const PrediveRow& row) { return row.verdict == PrediveVerdict::kBad; });
}

std::string reportTable(const PrediveReport& report, bool colours) {
  std::size_t width = 0, bad = 0;
  for (const PrediveRow& row : report.rows) width = std::max(width, row.name.size());
  std::string out;
  for (const PrediveRow& row : report.rows) {
    const char* colour = row.verdict == PrediveVerdict::kGood  ? "\033[32m"
                         : row.verdict == PrediveVerdict::kBad ? "\033[1;31m"
                                                               : "\033[90m";
    const char* label = row.verdict == PrediveVerdict::kGood  ? "green"
                        : row.verdict == PrediveVerdict::kBad ? "RED  "
                                                              : "-    ";
    bad += row.verdict == PrediveVerdict::kBad ? 1 : 0;
    out += (colours ? colour : "") + std::string(label) + (colours ? "\033[0m" : "") + "  " + row.name +
           std::string(width - row.name.size(), ' ') + "  " + row.found + "\n";
    if (!row.fix.empty()) out += "       " + std::string(width, ' ') + "  -> " + row.fix + "\n";
  }
  out += bad == 0 ? "All is well: ready to dive.\n"
                  : std::to_string(bad) + (bad == 1 ? " thing is" : " things are") + " wrong: do not dive.\n";
  return out;
}

std::string reportJson(const PrediveReport& report) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (const PrediveRow& row : report.rows) {
    nlohmann::ordered_json line = {{"name", row.name}, {"verdict", word(row.verdict)}, {"found", row.found}};
    if (!row.fix.empty()) line["fix"] = row.fix;
    rows.push_back(std::move(line));
  }
  const nlohmann::ordered_json all = {{"good", report.allGood()}, {"rows", std::move(rows)}};
  return all.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace fathom::io
