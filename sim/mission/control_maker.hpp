#pragma once

#include <cstdint>
#include <filesystem>

namespace fathom::sim {

struct ControlMakerOptions {
  std::filesystem::path out;  // none: control/ of the mission
  int points = 5, checks = 5, bars = 0;
  double sigma = 0.01;        // of a survey's north, east and down [m]
  double bar_length = 1;      // about [m]
  double bar_sigma = 0.0005;  // [m]
  double pixel_sigma = 0.7;   // of a mark's coordinate [px]
  int marks = 6;              // of a point, at most
  std::uint64_t seed = 1;
};

struct ControlMakerReport {
  std::filesystem::path folder;
  int points = 0, marks = 0, bars = 0;
};

// Writes surveyed control and check points, scale bars and their image marks for a simulated dive, with
// survey and mark errors; the points are far from each other and each is in several images. The tables are
// those that fathom-topside reads. Throws InputError for a mission without truth or without places seen by
// several pairs.
ControlMakerReport makeControl(const std::filesystem::path& mission, const ControlMakerOptions& options);

}  // namespace fathom::sim
