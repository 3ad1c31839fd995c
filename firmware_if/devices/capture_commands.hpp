#pragma once

#include <cstdio>
#include <filesystem>
#include <string>

#include "firmware_if/devices/can/n2k_decoder.hpp"

namespace fathom::io {

// `fathom-sensors dvl FILE [--csv]`.
struct DvlCommand {
  std::filesystem::path file;  // PD0 capture
  bool csv = false;            // a row per ensemble instead of the summary
};

// `fathom-sensors can FILE [--json]`.
struct CanCommand {
  std::filesystem::path file;  // a text capture (CanTextReader), or a mission's .lcmlog (RAW_CAN)
  bool json = false;           // one object a message instead of the summary
};

// Both decode a capture to `out`; counts go to `report` (stderr). They return the exit code, and throw
// InputError, with nothing written, for a file that is absent, empty or holds no ensemble or frame.
int runDvlCommand(const DvlCommand& command, std::FILE* out, std::FILE* report);
int runCanCommand(const CanCommand& command, std::FILE* out, std::FILE* report);

// {"time_s":1502984866.421964,"pgn":127250,"source":204,"fields":{"heading_rad":2.3154,"reference":"magnetic"}}
// Numbers have as many digits as are needed to read them back exactly; absent values and times are left out.
[[nodiscard]] std::string toJson(const N2kMessage& message);

}  // namespace fathom::io
