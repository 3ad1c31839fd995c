#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace fathom::io {

// "1 frame", "2 frames".
inline std::string plural(std::uint64_t count, const std::string& thing) {
  return std::to_string(count) + " " + thing + (count == 1 ? "" : "s");
}

enum class PrediveVerdict { kGood, kBad, kUnused };

// One line of the table: what was checked, what was found and, for a red one, what to do about it.
struct PrediveRow {
  std::string name;
  PrediveVerdict verdict = PrediveVerdict::kGood;
  std::string found;
  std::string fix;  // of a red row
};

struct PrediveReport {
  std::vector<PrediveRow> rows;
  [[nodiscard]] bool allGood() const;
  void good(std::string name, std::string found) {
    rows.push_back({std::move(name), PrediveVerdict::kGood, std::move(found), ""});
  }
  void bad(std::string name, std::string found, std::string fix) {
    rows.push_back({std::move(name), PrediveVerdict::kBad, std::move(found), std::move(fix)});
  }
  void unused(std::string name, std::string found) {
    rows.push_back({std::move(name), PrediveVerdict::kUnused, std::move(found), ""});
  }
};

// A line a row, a second one with the fix below a red row, a summary; with colours for a terminal.
[[nodiscard]] std::string reportTable(const PrediveReport& report, bool colours);
// {"good": false, "rows": [{"name", "verdict": "good"|"bad"|"unused", "found", "fix"}]}
[[nodiscard]] std::string reportJson(const PrediveReport& report);

}  // namespace fathom::io
