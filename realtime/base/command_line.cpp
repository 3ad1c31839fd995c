#include "realtime/base/command_line.hpp"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <memory>

namespace fathom {

CommandLine::CommandLine(const std::string& about, const std::string& text, Run run)
    : CLI::App(about), run_(std::move(run)) {
  footer(text);
  if (!run_) require_subcommand(1);
}

CommandLine& CommandLine::command(const std::string& name, const std::string& about, const std::string& text,
                                  Run run) {
  const std::shared_ptr<CommandLine> made(new CommandLine(name, about, std::move(run), this));
  add_subcommand(made)->footer(text);
  return *made;
}

int CommandLine::run(const std::string& program, int argc, char** argv, const std::string& version) noexcept {
  const auto end = [&](const std::string& line, int status) {
    std::fprintf(stderr, "%s: %s\n", program.c_str(), line.c_str());
    return status;
  };
  try {
    if (!version.empty()) set_version_flag("--version", version);
    parse(argc, argv);
    const auto commands = get_subcommands();
    return (commands.empty() ? *this : dynamic_cast<CommandLine&>(*commands.front())).run_();
  } catch (const CLI::Success& help) {
    return exit(help);
  } catch (const CLI::ParseError& error) {
    std::string line = error.what();
    std::ranges::replace(line, '\n', ' ');
    return end(line + " (see --help)", kExitBadInput);
  } catch (const InputError& error) {
    return end(error.what(), kExitBadInput);
  } catch (const std::exception& error) {
    return end(std::string("failed: ") + error.what(), kExitFailedWork);
  }
}

}  // namespace fathom
