#pragma once

#include <filesystem>
#include <string>

namespace fathom::topside {

// A finished run as one project of QGIS (3.22 and later): in `folder`, survey.qgs, and beside it survey.gpkg
// (writeSurveyGeopackage()) with footprints, track and contours; under these all layers of the results, where
// they are, in the colours that the run gave them, orthomosaic and elevation shown. The project's system is
// `crs`; QGIS turns the layers. Throws InputError for results that are not as a run writes them, and where
// the folder holds other files.
void writeQgisProject(const std::filesystem::path& folder, const std::filesystem::path& results,
                      const std::string& crs, double contours);

struct GeopackageCounts {
  std::size_t footprints = 0, contours = 0;
};

// A finished run as vectors for geographic information systems, from its folder of results, in the coordinate
// reference system `crs` (as "EPSG:32755"; empty: the results' own, which is none), depths and heights in
// metres:
//   footprints  polygons: what each left image shows, as images.json says; left, right, utc, altitude_m,
//               depth_m, heading_deg of the image's top
//   track       lines with z (up), one for each stretch that is known; begin_utc, end_utc
//   contours    lines with height_m, of layers/elevation.tif, every `interval` metres; 0: the finest of
//               1, 2, 5 times a power of ten that gives at most twenty of them
// Layers without anything in them are left out. Throws InputError for results that are not as a run writes
// them.
GeopackageCounts writeSurveyGeopackage(const std::filesystem::path& path,
                                       const std::filesystem::path& results, const std::string& crs,
                                       double interval);

}  // namespace fathom::topside
