#include "telemetry/monitor/export/geo_raster.hpp"

#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>

namespace fathom::monitor {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kPatch = 64;  // pixels; inside one the projections differ by less than 0.1 mm from bilinear

using Transformation =
    std::unique_ptr<OGRCoordinateTransformation, decltype(&OGRCoordinateTransformation::DestroyCT)>;

Transformation transformation(int from, int to) {
  OGRSpatialReference source, target;
  if (source.importFromEPSG(from) != OGRERR_NONE || target.importFromEPSG(to) != OGRERR_NONE)
    throw std::runtime_error("PROJ's database does not know EPSG:" + std::to_string(from));
  source.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  target.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return {OGRCreateCoordinateTransformation(&source, &target), &OGRCoordinateTransformation::DestroyCT};
}

constexpr int kGeographic = 4326;

struct LocalBounds {
  double north0 = 1e9, north1 = -1e9, east0 = 1e9, east1 = -1e9;
  [[nodiscard]] bool empty() const { return north1 < north0; }
};

LocalBounds boundsOf(const BlockStore& store, Surface& surface) {
  LocalBounds b;
  for (const auto& [key, chunk] : store.chunks()) {
    for (const auto& v : surface.mesh(key).vertices) {
      const double n = key.north * kChunkSize_m + double(v.north) / kUnitsPerMetre;
      const double e = key.east * kChunkSize_m + double(v.east) / kUnitsPerMetre;
      b.north0 = std::min(b.north0, n);
      b.north1 = std::max(b.north1, n);
      b.east0 = std::min(b.east0, e);
      b.east1 = std::max(b.east1, e);
    }
  }
  return b;
}

double pixelOf(const BlockStore& store, double area) {
  for (telemetry::SpacingCode code = 0; code < kLevels; ++code) {
    const double spacing = telemetry::spacingOf(code);
    const double covered =
        static_cast<double>(store.size(code)) * telemetry::MapBlock::kNodes * spacing * spacing;
    if (covered >= area / 10) return std::max(spacing, kLeastPixel_m);
  }
  return 1;
}

void fillPatch(GeoRaster& raster, int row0, int column0, const Surface& surface,
               const std::array<Eigen::Vector2d, 4>& corners) {
  const int rows = std::min(kPatch, raster.height - row0), columns = std::min(kPatch, raster.width - column0);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const double v = (r + 0.5) / kPatch, u = (c + 0.5) / kPatch;
      const Eigen::Vector2d place =
          (1 - v) * ((1 - u) * corners[0] + u * corners[1]) + v * ((1 - u) * corners[2] + u * corners[3]);
      const auto point = surface.sample(place.x(), place.y());
      if (!point) continue;
      const auto at = static_cast<std::size_t>(row0 + r) * static_cast<std::size_t>(raster.width) +
                      static_cast<std::size_t>(column0 + c);
      raster.elevation[at] = static_cast<float>(-point->depth);
      if (!point->has_colour) continue;
      for (std::size_t k = 0; k < 3; ++k)
        raster.colour[4 * at + k] = static_cast<std::uint8_t>(std::lround(point->colour[k]));
      raster.colour[4 * at + 3] = 255;
    }
  }
}

}  // namespace

int epsgOf(const Geodetic& origin) {
  const double latitude = origin.latitude / kDegree, longitude = origin.longitude / kDegree;
  constexpr double kUtmNorth = 84, kUtmSouth = -80;
  constexpr int kUpsNorth = 32661, kUpsSouth = 32761;
  if (latitude > kUtmNorth) return kUpsNorth;
  if (latitude < kUtmSouth) return kUpsSouth;
  const int zone = static_cast<int>(std::floor((longitude + 180) / 6)) % 60 + 1;
  return (latitude < 0 ? 32700 : 32600) + zone;
}

std::optional<GeoRaster> rasterOf(const BlockStore& store, Surface& surface, const Geodetic& origin) {
  const LocalBounds bounds = boundsOf(store, surface);
  if (bounds.empty()) return std::nullopt;
  GeoRaster raster;
  raster.epsg = epsgOf(origin);
  const LocalTransverseMercator local(origin);
  const Transformation to_map = transformation(kGeographic, raster.epsg),
                       from_map = transformation(raster.epsg, kGeographic);
  if (!to_map || !from_map)
    throw std::runtime_error("PROJ gives no way to EPSG:" + std::to_string(raster.epsg));

  // The rim of the map in the projection: its extreme points lie on the rim of the rectangle in nav.
  double west = 1e12, east = -1e12, south = 1e12, north = -1e12;
  constexpr int kRim = 8;  // points a side
  for (int i = 0; i <= kRim; ++i) {
    const double n = bounds.north0 + (bounds.north1 - bounds.north0) * i / kRim;
    const double e = bounds.east0 + (bounds.east1 - bounds.east0) * i / kRim;
    for (const Eigen::Vector2d& p : {Eigen::Vector2d(n, bounds.east0), Eigen::Vector2d(n, bounds.east1),
                                     Eigen::Vector2d(bounds.north0, e), Eigen::Vector2d(bounds.north1, e)}) {
      const Geodetic g = local.toGeodetic(p);
      double x = g.longitude / kDegree, y = g.latitude / kDegree;
      if (!to_map->Transform(1, &x, &y)) throw std::runtime_error("the map lies outside its projection");
      west = std::min(west, x);
      east = std::max(east, x);
      south = std::min(south, y);
      north = std::max(north, y);
    }
  }
  raster.pixel = pixelOf(store, surface.area());
  const auto pixels = [&](double low, double high) {
    return static_cast<std::int64_t>(std::ceil(high / raster.pixel)) -
           static_cast<std::int64_t>(std::floor(low / raster.pixel));
  };
  while (pixels(west, east) * pixels(south, north) > kMaxPixels) raster.pixel *= 2;
  raster.west = std::floor(west / raster.pixel) * raster.pixel;
  raster.north = std::ceil(north / raster.pixel) * raster.pixel;
  raster.width = static_cast<int>(std::max<std::int64_t>(1, pixels(west, east)));
  raster.height = static_cast<int>(std::max<std::int64_t>(1, pixels(south, north)));
  const auto count = static_cast<std::size_t>(raster.width) * static_cast<std::size_t>(raster.height);
  raster.elevation.assign(count, std::numeric_limits<float>::quiet_NaN());
  raster.colour.assign(4 * count, 0);

  for (int row = 0; row < raster.height; row += kPatch) {
    for (int column = 0; column < raster.width; column += kPatch) {
      std::array<Eigen::Vector2d, 4> corners;
      for (int k = 0; k < 4; ++k) {
        double x = raster.west + (column + k % 2 * kPatch) * raster.pixel;
        double y = raster.north - (row + k / 2 * kPatch) * raster.pixel;
        if (!from_map->Transform(1, &x, &y)) throw std::runtime_error("the map lies outside its projection");
        corners[static_cast<std::size_t>(k)] = local.toLocal({y * kDegree, x * kDegree});
      }
      fillPatch(raster, row, column, surface, corners);
    }
  }
  return raster;
}

}  // namespace fathom::monitor
