#pragma once

#include <filesystem>
#include <string>

#include "recon/compare/difference.hpp"
#include "recon/compare/registration.hpp"
#include "recon/compare/surface_file.hpp"

namespace fathom::compare {

struct CompareOptions {
  std::filesystem::path survey, reference, out;
  std::string reference_crs;  // of a reference that does not say; empty: the survey's own frame
  std::string reference_up;  // "up", "down", or "auto": the sign that agrees better with the survey's heights
  double cell = 0;           // [m]; 0: the coarser of the two surfaces' own
  RegistrationConfig registration;
  FrameBeside beside;  // of meshes; empty: their frame stays unknown
};

struct Comparison {
  CompareOptions options;
  std::string survey_about, reference_about;
  std::vector<std::string> notes;
  double survey_spacing = 0, reference_spacing = 0, cell = 0;  // [m]
  bool reference_turned = false;                               // it held depths
  HeightMap survey, reference;                                 // on one lattice
  PlaneFrame plane;
  Registration registration;
  Difference difference;
};

// Reads both, brings the reference into the survey's frame, registers, takes the difference. Throws
// InputError for what cannot be read, and where the two have nothing in common.
[[nodiscard]] Comparison compareSurfaces(const CompareOptions& options);

}  // namespace fathom::compare
