#pragma once

#include <filesystem>
#include <string>

#include "recon/compare/difference.hpp"
#include "recon/compare/surface_file.hpp"
#include "recon/compare/surface_registration.hpp"

namespace fathom::compare {

struct CompareOptions {
  std::filesystem::path survey, reference, out;
  std::string reference_crs;  // of a reference without one; empty: the survey's own frame
  std::string reference_up;  // "up", "down", or "auto": the sign that agrees better with the survey's heights
  double cell = 0;           // [m]; 0: the coarser of the two surfaces' own
  SurfaceRegistrationConfig registration;
  FrameBeside beside;  // of meshes; empty: their frame stays unknown
};

struct Comparison {
  CompareOptions options;
  std::string survey_about, reference_about;
  std::vector<std::string> notes;
  double survey_spacing = 0, reference_spacing = 0, cell = 0;  // [m]
  bool reference_turned = false;                               // it held depths, which were negated
  HeightMap survey, reference;                                 // on one lattice
  PlaneFrame plane;
  SurfaceRegistration registration;
  Difference difference;
};

// Reads both surfaces, transforms the reference into the survey's frame, registers them and takes the
// difference. Throws InputError for an unreadable file and for surfaces without overlap.
[[nodiscard]] Comparison compareSurfaces(const CompareOptions& options);

}  // namespace fathom::compare
