#pragma once

#include <filesystem>

namespace fathom {

// The folder that this program is installed in: PREFIX of PREFIX/bin/fathom-..., beside which what ships with
// it lies (PREFIX/share/fathom, PREFIX/lib/fathom). The build tree is laid out in the same way.
[[nodiscard]] std::filesystem::path installPrefix();

}  // namespace fathom
