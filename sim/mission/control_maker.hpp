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

// What a diver would have surveyed on a simulated dive's seafloor, and somebody marked in its images: points
// far apart from each other that several images see, with errors of survey and of marks. Tables as
// fathom-topside reads them. Throws InputError for a mission without truth, and for one whose images see too
// few places twice.
ControlMakerReport makeControl(const std::filesystem::path& mission, const ControlMakerOptions& options);

}  // namespace fathom::sim
