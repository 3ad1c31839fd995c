#pragma once

#include <string>

namespace fathom {

// What --version prints: "fathom-sim 0.1.0 (1f3bc9a)", with the git revision that was built, "-dirty" where
// the tree differed from it, "unknown" outside git. Library `fathom_version`, for programs alone.
[[nodiscard]] std::string versionLine(const std::string& program);

}  // namespace fathom
