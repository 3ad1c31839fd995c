#pragma once

#include <filesystem>
#include <string>

#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

struct Summary {
  std::size_t pairs = 0, used = 0, unreadable = 0;
  std::size_t triangles = 0;
  double area = 0;     // [m^2]
  double seconds = 0;  // in all
};

// The whole way from a mission folder to `out`: lighting, stereo, navigation, fusion, report.
// Everything appears in `out` at once, at the end. Throws InputError for a mission that cannot be used: a
// file absent or broken, or no pair that gives a mesh.
Summary runTopside(const std::filesystem::path& mission_folder, const std::filesystem::path& out,
                   const TopsideConfig& config);

}  // namespace fathom::topside
