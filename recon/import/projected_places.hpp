#pragma once

#include <memory>
#include <optional>
#include <string>

#include "recon/geometry/geodesy.hpp"

class OGRCoordinateTransformation;

namespace fathom::topside {

// Eastings and northings to longitudes and latitudes.
class ProjectedPlaces {
 public:
  // `option`: that gave `crs`. Throws InputError for what is no projected coordinate reference system.
  ProjectedPlaces(const std::string& option, const std::string& crs);
  // None: outside of the system.
  [[nodiscard]] std::optional<Geodetic> operator()(double east, double north) const;

 private:
  struct Destroy {
    void operator()(OGRCoordinateTransformation* t) const;
  };
  std::unique_ptr<OGRCoordinateTransformation, Destroy> transform_;
};

}  // namespace fathom::topside
