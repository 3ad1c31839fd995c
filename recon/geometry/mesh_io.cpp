#include "recon/geometry/mesh_io.hpp"

namespace fathom {

Mesh readPly(const std::filesystem::path&) { return {}; }
void writePly(const std::filesystem::path&, const Mesh&, const std::vector<std::string>&) {}

}  // namespace fathom
