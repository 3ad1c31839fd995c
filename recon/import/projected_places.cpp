#include "recon/import/projected_places.hpp"

#include <ogr_spatialref.h>

#include <cpl_error.h>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {

ProjectedPlaces::ProjectedPlaces(const std::string& option, const std::string& crs) {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  OGRSpatialReference from, to;
  if (from.SetFromUserInput(crs.c_str()) != OGRERR_NONE || to.importFromEPSG(4326) != OGRERR_NONE ||
      !from.IsProjected())
    throw InputError(option, crs, "is no projected coordinate reference system; give one as EPSG:32755");
  from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  transform_.reset(OGRCreateCoordinateTransformation(&from, &to));
  if (!transform_) throw InputError(option, crs, "cannot be turned into latitudes and longitudes");
}

std::optional<Geodetic> ProjectedPlaces::operator()(double east, double north) const {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  if (transform_->Transform(1, &east, &north) == 0) return {};
  return Geodetic{north * kRadiansPerDegree, east * kRadiansPerDegree};
}

void ProjectedPlaces::Destroy::operator()(OGRCoordinateTransformation* t) const {
  OGRCoordinateTransformation::DestroyCT(t);
}

}  // namespace fathom::topside
