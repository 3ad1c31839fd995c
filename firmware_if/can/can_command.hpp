#pragma once

#include <cstdio>
#include <filesystem>
#include <string>

#include "firmware_if/can/n2k_decoder.hpp"

namespace fathom::io {

// `fathom-sensors can FILE [--json]`.
struct CanCommand {
  std::filesystem::path file;  // a text capture (CanTextReader), or a mission's .lcmlog (RAW_CAN)
  bool json = false;           // one object a message instead of the summary
};

// Decodes the capture to `out`; counts go to `report` (stderr). Returns the exit code. Throws InputError for
// a file that is absent, empty or holds no frame; then nothing was written.
int runCanCommand(const CanCommand& command, std::FILE* out, std::FILE* report);

// {"time_s":1502984866.421964,"pgn":127250,"source":204,"fields":{"heading_rad":2.3154,"reference":"magnetic"}}
// Numbers have as many digits as are needed to read them back exactly; what is absent is left out, the time
// too.
[[nodiscard]] std::string toJson(const N2kMessage& message);

}  // namespace fathom::io
