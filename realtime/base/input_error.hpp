#pragma once

#include <stdexcept>
#include <string>

#include "realtime/base/text.hpp"

namespace fathom {

// Invalid input found at set-up or by a tool: one line that names the file, the place in it and the remedy.
// Thrown only outside the onboard tiers, where invalid input is an event with a counter.
class InputError : public std::runtime_error {
 public:
  // `file`: path as the user gave it. `place`: line, byte, key or field ("" = the whole file). `fix`: what is
  // wrong and how to correct it. Line ends, control characters and bytes that are not UTF-8 become '?', so
  // that the message is one line that no terminal interprets.
  InputError(const std::string& file, const std::string& place, const std::string& fix)
      : std::runtime_error(printableText(file + ": " + (place.empty() ? "" : place + ": ") + fix)) {}
};

enum ExitCode : int {
  kExitSuccess = 0,
  kExitFailedWork = 1,  // the input was good, the work could not be done (disk full, device lost)
  kExitBadInput = 2,    // bad usage or bad input
};

}  // namespace fathom
