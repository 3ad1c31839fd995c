#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "recon/compare/plane_frame.hpp"
#include "recon/compare/surface_file.hpp"
#include "recon/compare/surface_registration.hpp"

namespace fathom::compare {

// Statistics of height differences, survey less reference [m].
struct DifferenceStatistics {
  std::size_t cells = 0;
  double bias = 0, median = 0;    // mean, median
  double rms = 0, deviation = 0;  // root mean square; standard deviation about the mean
  double mad = 0;                 // 1.4826 times the median absolute deviation: standard deviation if normal
  double p1 = 0, p5 = 0, p25 = 0, p75 = 0, p95 = 0, p99 = 0;  // signed percentiles
  double abs_p50 = 0, abs_p95 = 0;                            // of the magnitudes
};
[[nodiscard]] DifferenceStatistics statisticsOf(std::vector<double> differences);

// Statistics of the cells with a `quantity` in [from, to).
struct DifferenceClass {
  double from = 0, to = 0;
  DifferenceStatistics statistics;
  double rms_over_sigma = 0;  // in a class of uncertainty: 1 if the stated sigma is right
};

struct Difference {
  HeightMap map;                          // survey less reference, at the reference's position
  DifferenceStatistics before;            // at the survey's own position
  DifferenceStatistics after;             // after registration
  std::vector<DifferenceClass> by_slope;  // slope of the reference [deg]
  std::vector<DifferenceClass> by_sigma;  // by the survey's stated sigma [m]; empty without one
  double overlap_m2 = 0;                  // area compared
  double survey_m2 = 0;                   // area of the survey
};

// `reference` on the survey's lattice of cells, reaching further.
[[nodiscard]] Difference differenceOf(const HeightMap& survey, const HeightMap& reference,
                                      const RegistrationOffset& offset);

// North up, red where the survey is above the reference, blue below; ends of the scale at +-`limit` [m]; with
// a legend and a scale bar. PNG.
void drawDifference(const HeightMap& difference, double limit, const std::filesystem::path& png);
// Heights between `low` and `high` [m] by colour (viridis), shaded from the north-west, with a legend.
void drawHeights(const HeightMap& map, double low, double high, const std::filesystem::path& png);
// float32 GeoTIFF (COG), NaN where unknown; georeferenced where the frame is known.
void writeGeoTiff(const HeightMap& map, const PlaneFrame& frame, const std::filesystem::path& tif);

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
