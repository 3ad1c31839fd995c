#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>

#include "realtime/base/input_error.hpp"

namespace fathom {

// The command line of a program, and that of each of its commands: options as CLI11 declares them, and what
// runs once they are parsed.
class CommandLine : public CLI::App {
 public:
  // Gives the exit status. An InputError ends the program with kExitBadInput and one line on stderr, any
  // other exception with kExitFailedWork.
  using Run = std::function<int()>;

  // A program; without `run` one of its commands must be named. `footer`: examples below the options.
  explicit CommandLine(const std::string& about, const std::string& footer = "", Run run = {});

  // Adds the command `name`.
  CommandLine& command(const std::string& name, const std::string& about, const std::string& footer, Run run);

  // An option whose default --help shows; a number's from `low` to `high`.
  template <class Value>
  CLI::Option* shown(const std::string& name, Value& value, const std::string& help) {
    return add_option(name, value, help)->capture_default_str();
  }
  template <class Value, class Low, class High>
  CLI::Option* shown(const std::string& name, Value& value, const std::string& help, Low low, High high) {
    using Bound = std::conditional_t<std::is_floating_point_v<Value>, double, std::common_type_t<Low, High>>;
    return shown(name, value, help)->check(CLI::Range(static_cast<Bound>(low), static_cast<Bound>(high)));
  }

  // Parses and runs: the body of main. Wrong usage is bad input. `version`: what --version prints.
  int run(const std::string& program, int argc, char** argv, const std::string& version = "") noexcept;

 private:
  CommandLine(const std::string& name, const std::string& about, Run run, CommandLine* program)
      : CLI::App(about, name, program), run_(std::move(run)) {}

  Run run_;
};

// What --version prints: "fathom-sim 0.1.0 (1f3bc9a)" with the git revision of the build, "-dirty" where the
// tree differed from it, "unknown" outside git. In library `fathom_version`, which only programs link.
[[nodiscard]] std::string versionLine(const std::string& program);

}  // namespace fathom
