#pragma once

#include <cstdio>
#include <filesystem>

namespace fathom::io {

// `fathom-sensors dvl FILE [--csv]`.
struct DvlCommand {
  std::filesystem::path file;  // PD0 capture
  bool csv = false;            // a row per ensemble instead of the summary
};

// Decodes the capture to `out`; counts of good, bad-checksum and resynced ensembles go to `report` (stderr).
// Returns the exit code. Throws InputError for a file that is absent, empty or holds no ensemble; then
// nothing was written.
int runDvlCommand(const DvlCommand& command, std::FILE* out, std::FILE* report);

}  // namespace fathom::io
