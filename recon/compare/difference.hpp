#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "recon/compare/height_map.hpp"
#include "recon/compare/registration.hpp"

namespace fathom::compare {

// Of heights' differences, survey less reference [m].
struct DifferenceStatistics {
  std::size_t cells = 0;
  double bias = 0, median = 0;    // mean, median
  double rms = 0, deviation = 0;  // root mean square; standard deviation about the mean
  double mad = 0;                 // 1.4826 times the median absolute deviation: standard deviation if normal
  double p1 = 0, p5 = 0, p25 = 0, p75 = 0, p95 = 0, p99 = 0;  // signed percentiles
  double abs_p50 = 0, abs_p95 = 0;                            // of the magnitudes
};
[[nodiscard]] DifferenceStatistics statisticsOf(std::vector<double> differences);

// The statistics of those cells whose `quantity` lies in [from, to).
struct DifferenceClass {
  double from = 0, to = 0;
  DifferenceStatistics statistics;
  double rms_over_sigma = 0;  // where the class is one of uncertainty: 1 is honest
};

struct Difference {
  HeightMap map;                          // survey less reference, in the reference's place
  DifferenceStatistics before;            // where the survey says that it lies
  DifferenceStatistics after;             // after registration
  std::vector<DifferenceClass> by_slope;  // slope of the reference [deg]
  std::vector<DifferenceClass>
      by_sigma;           // what the survey claims of its heights [m]; empty where it does not
  double overlap_m2 = 0;  // area compared
  double survey_m2 = 0;   // area of the survey
};

// `reference` on the survey's lattice of cells, reaching further.
[[nodiscard]] Difference differenceOf(const HeightMap& survey, const HeightMap& reference,
                                      const Offset& offset);

}  // namespace fathom::compare
