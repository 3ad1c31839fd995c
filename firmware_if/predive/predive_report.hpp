#pragma once

#include <string>
#include <vector>

namespace fathom::io {

enum class Verdict { kGood, kBad, kUnused };

// One line of the table: what was looked at, what was found, and for a red one what to do about it.
struct PrediveRow {
  std::string name;
  Verdict verdict = Verdict::kGood;
  std::string found;
  std::string fix;  // of a red row
};

struct PrediveReport {
  std::vector<PrediveRow> rows;
  [[nodiscard]] bool allGood() const;
  void good(std::string name, std::string found) {
    rows.push_back({std::move(name), Verdict::kGood, std::move(found), ""});
  }
  void bad(std::string name, std::string found, std::string fix) {
    rows.push_back({std::move(name), Verdict::kBad, std::move(found), std::move(fix)});
  }
  void unused(std::string name, std::string found) {
    rows.push_back({std::move(name), Verdict::kUnused, std::move(found), ""});
  }
};

// A line a row, a second one with the fix below a red row, a summary; with colours for a terminal.
[[nodiscard]] std::string reportTable(const PrediveReport& report, bool colours);
// {"good": false, "rows": [{"name", "verdict": "good"|"bad"|"unused", "found", "fix"}]}
[[nodiscard]] std::string reportJson(const PrediveReport& report);

}  // namespace fathom::io
