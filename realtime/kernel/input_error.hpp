#pragma once

#include <functional>
#include <stdexcept>
#include <string>

namespace fathom {

// Bad input found at set-up or by a tool: one line that names the file, the place in it and the fix.
// Thrown only outside the onboard tiers; on board, bad input is an event with a counter.
class InputError : public std::runtime_error {
 public:
  // `file`: path as the user gave it. `place`: line, byte, key or field ("" = the whole file).
  // `fix`: what is wrong and what to do about it.
  // Line ends, other control characters and bytes that are no UTF-8, as a damaged file has them, become '?':
  // it stays one line, and a terminal unharmed.
  InputError(const std::string& file, const std::string& place, const std::string& fix);
};

enum ExitCode : int {
  kExitSuccess = 0,
  kExitFailedWork = 1,  // the input was good, the work could not be done (disk full, device lost)
  kExitBadInput = 2,    // bad usage or bad input
};

// Runs the body of a program's main: an InputError prints one line on stderr and gives exit code 2,
// any other exception one line and exit code 1.
int runTool(const char* program, const std::function<int()>& body) noexcept;

}  // namespace fathom
