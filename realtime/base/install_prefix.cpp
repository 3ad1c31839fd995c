#include "realtime/base/install_prefix.hpp"

namespace fathom {

std::filesystem::path installPrefix() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path();
}

}  // namespace fathom
