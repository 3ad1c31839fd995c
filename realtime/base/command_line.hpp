#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>
#include <optional>
#include <string>

#include "realtime/base/input_error.hpp"

namespace fathom {

// Parses a program's command line. Returns an exit code if the program is to end now: after --help and the
// like, or after wrong usage, which is reported in one line on stderr.
inline std::optional<int> parseCommandLine(const char* program, CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::string line = error.what();
    for (char& c : line)
      if (c == '\n') c = ' ';
    std::fprintf(stderr, "%s: %s (see --help)\n", program, line.c_str());
    return kExitBadInput;
  }
  return std::nullopt;
}

}  // namespace fathom
