#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace fathom::sim {

enum class TerrainKind : std::uint8_t { kProcedural, kMesh };

// Sand waves: asymmetric crests that meander and fork. height_m = 0: none.
struct RippleConfig {
  double wavelength_m = 0.22;
  double height_m = 0.025;     // trough to crest
  double direction_rad = 0.4;  // of the current that formed them, clockwise from north
  double meander = 1;          // 1: crests meander and fade out; 0: straight, the same everywhere
};

// Loose stones and coral pieces, partly buried, in patches.
struct RubbleConfig {
  double density_per_m2 = 8.0;  // mean over the whole terrain; 0: none
  double min_size_m = 0.03;     // longest diameter
  double max_size_m = 0.15;
  double patchiness = 0.7;  // 0 even, 1 only in patches
};

struct BoulderConfig {
  double density_per_m2 = 0.03;
  double min_size_m = 0.3;  // longest diameter
  double max_size_m = 1.2;
};

// Coral heads on a narrow foot: their caps overhang and hide the seafloor below them.
struct CoralConfig {
  double density_per_m2 = 0.06;
  double min_size_m = 0.2;  // diameter of the cap
  double max_size_m = 0.9;
  double overhang = 0.35;  // foot is thinner than the cap by this fraction, 0 to 0.8
};

// A drop-off: along a meandering line the seafloor falls by drop_m towards heading_rad.
struct LedgeConfig {
  double north_m = 0;  // a point on the line
  double east_m = 0;
  double heading_rad = 0;  // horizontal direction of descent, clockwise from north
  double drop_m = 3.0;
  double width_m = 0.6;      // horizontal distance over which it falls
  double undercut_m = 0.25;  // by which the lip overhangs the wall
};

// A stone or coral head at a chosen place. Equal seed and size give equal shapes.
struct PlacedConfig {
  bool coral = false;
  std::uint64_t seed = 1;
  double north_m = 0, east_m = 0;
  double heading_rad = 0;  // clockwise from above
  double size_m = 0.8;     // longest diameter
};

struct TerrainConfig {
  TerrainKind kind = TerrainKind::kProcedural;
  std::uint64_t seed = 1;
  double centre_north_m = 0;
  double centre_east_m = 0;
  double base_depth_m = 20.0;  // procedural: mean depth before ledges; mesh: depth of its mean vertex

  // kProcedural
  double size_north_m = 20.0;
  double size_east_m = 20.0;
  double grid_spacing_m = 0.02;  // of the sand's vertices; 60 x 60 m at 0.025 m takes about 0.6 GB
  double undulation_m = 0.25;    // standard deviation of the broad relief
  double undulation_wavelength_m = 7.0;
  double roughness_m = 0.006;  // standard deviation of relief below 0.5 m
  RippleConfig ripples;
  RubbleConfig rubble;
  BoulderConfig boulders;
  CoralConfig corals;
  std::vector<LedgeConfig> ledges;
  std::vector<PlacedConfig> placed;
  // A raster of heights [m] of a real seafloor that is added to the bed, its middle at the terrain's centre
  // and its mean at base_depth_m; empty: none. Scaled so that its cells have sides of `relief_cell_m`; 0: as
  // stated.
  std::filesystem::path relief_file;
  double relief_cell_m = 0;

  // kMesh: PLY in north, east, down [m]; moved so that its centre is at (centre_north_m, centre_east_m) and
  // its mean depth at base_depth_m. `texture_file` may be empty (vertex colours, else grey).
  std::filesystem::path mesh_file;
  std::filesystem::path texture_file;

  // A folder of photographs of a seafloor, in place of the colours and the fine texture above; empty: none.
  std::filesystem::path albedo_images;
  double albedo_pixel_m = 0.0014;
  double albedo_contrast = 1;

  // Procedural albedo detail, from 1.5 mm up to the size of what the surface's own colour resolves.
  double detail_contrast = 0.22;  // standard deviation relative to the albedo; 0: none

  // Moving objects; they are in pictures, not in the truth surface.
  int fish = 0;                       // swimming circuits over the terrain
  double swaying_density_per_m2 = 0;  // blades of sea grass and soft coral that sway with the swell
};

// Throws std::invalid_argument that names the member and its range.
void validate(const TerrainConfig& config);

}  // namespace fathom::sim
