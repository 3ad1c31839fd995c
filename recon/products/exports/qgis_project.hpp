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

}  // namespace fathom::topside
