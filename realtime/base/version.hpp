#pragma once

#include <string>

namespace fathom {

// Output of --version: "fathom-sim 0.1.0 (1f3bc9a)" with the git revision of the build, "-dirty" where the
// tree differed from it, "unknown" outside git. In library `fathom_version`, which only programs link.
[[nodiscard]] std::string versionLine(const std::string& program);

}  // namespace fathom
