#include "tests/support/report_program.hpp"

#include <CLI/CLI.hpp>
#include <cmath>
#include <type_traits>

#include "realtime/base/command_line.hpp"

namespace fathom::test {
namespace {

CLI::Option* add(CLI::App& app, const ReportOption& option) {
  return std::visit(
      [&](auto* value) -> CLI::Option* {
        using Value = std::remove_pointer_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, bool>) return app.add_flag(option.name, *value, option.help);
        CLI::Option* made = app.add_option(option.name, *value, option.help);
        if constexpr (std::is_arithmetic_v<Value>) {
          made->capture_default_str();
          if (std::isfinite(option.low)) made->check(CLI::Range(option.low, option.high));
        }
        if constexpr (std::is_same_v<Value, std::vector<int>> ||
                      std::is_same_v<Value, std::vector<std::size_t>>)
          made->delimiter(',')->capture_default_str();
        return made;
      },
      option.value);
}

}  // namespace

int runReports(const char* program, const std::vector<Report>& reports, int argc, char** argv) {
  CLI::App app("Measures Fathom as a whole: a table on stdout, and pages where --out names a folder");
  app.require_subcommand(1);
  const Report* chosen = nullptr;
  for (const Report& report : reports) {
    CLI::App* command = app.add_subcommand(report.name, report.help);
    for (const ReportOption& option : report.options) add(*command, option)->required(option.required);
    command->callback([&chosen, &report] { chosen = &report; });
  }
  if (const auto code = parseCommandLine(program, app, argc, argv)) return *code;
  return runTool((std::string(program) + " " + chosen->name).c_str(), chosen->run);
}

}  // namespace fathom::test
