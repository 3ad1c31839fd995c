#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::fusion {

// One local mesh as stereo gives it, and the same points where they truly are.
struct Scan {
  Mesh mesh, oracle;  // nav
  SE3 T_nav_cam;
};

struct ScanSet {
  std::string name;
  Camera camera;
  std::vector<Scan> scans;
  std::shared_ptr<const sim::TruthSurface> truth;
};

// Consecutive pairs of a simulated mission, matched by the pipeline's stereo, at their true poses.
[[nodiscard]] ScanSet scansOf(const std::filesystem::path& mission, std::size_t first, std::size_t count);

// A rolling seafloor z(north, east) of known equation, passed over in lines 0.7 m apart at 2 m, 0.25 m from
// mesh to mesh; some 700 points a mesh with noise along the ray that grows with its square.
[[nodiscard]] ScanSet analyticScans(std::size_t count);

}  // namespace fathom::fusion
