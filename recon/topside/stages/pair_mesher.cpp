#include "recon/topside/stages/pair_mesher.hpp"

namespace fathom::topside {

double footprintRadius(const Mesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  Eigen::Vector2f low = mesh.vertices[0].head<2>(), high = low;
  for (const auto& v : mesh.vertices) {
    low = low.cwiseMin(v.head<2>());
    high = high.cwiseMax(v.head<2>());
  }
  return 0.5 * static_cast<double>((high - low).norm());
}

}  // namespace fathom::topside
