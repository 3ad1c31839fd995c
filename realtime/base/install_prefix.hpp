#pragma once

#include <filesystem>

namespace fathom {

// PREFIX of this program's path PREFIX/bin/fathom-...; its data files are in PREFIX/share/fathom and
// PREFIX/lib/fathom. The build tree has the same layout.
[[nodiscard]] std::filesystem::path installPrefix();

}  // namespace fathom
