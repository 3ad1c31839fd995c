#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <variant>
#include <vector>

namespace fathom::test {

// An option of a report: where its value goes, which is its default until then. A name without dashes is an
// argument by place. Numbers of a list stand with commas between them.
struct ReportOption {
  using Value = std::variant<bool*, int*, unsigned*, std::int64_t*, std::size_t*, double*, std::string*,
                             std::filesystem::path*, std::vector<int>*, std::vector<std::size_t>*,
                             std::vector<std::string>*, std::vector<std::filesystem::path>*>;
  std::string name;
  Value value;
  std::string help;
  double low = -std::numeric_limits<double>::infinity(), high = std::numeric_limits<double>::infinity();
  bool required = false;
};
[[nodiscard]] inline ReportOption required(ReportOption option) {
  option.required = true;
  return option;
}

// A measurement of the whole: a subcommand of a program. `run` gives the exit status; it may throw.
struct Report {
  std::string name, help;
  std::vector<ReportOption> options;
  std::function<int()> run;
};

// The main of a program of such subcommands: parses, runs the one that is named. Exit status.
[[nodiscard]] int runReports(const char* program, const std::vector<Report>& reports, int argc, char** argv);

}  // namespace fathom::test
