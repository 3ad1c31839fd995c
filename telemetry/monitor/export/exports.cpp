#include "telemetry/monitor/export/exports.hpp"

#include <cpl_string.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"

namespace fathom::monitor {

using nlohmann::ordered_json;

namespace {

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

void checkGdal(CPLErr result) {
  if (result != CE_None) throw std::runtime_error(std::string("GDAL: ") + CPLGetLastErrorMsg());
}

// Encodes the file in memory.
template <class Write>
std::string tiff(const GeoRaster& raster, int bands, GDALDataType type, const char* predictor, Write write) {
  static std::once_flag once;
  std::call_once(once, [] { GDALAllRegister(); });
  static std::atomic<unsigned> number{0};
  const std::string name = "/vsimem/fathom-export-" + std::to_string(number++) + ".tif";
  CPLStringList options;
  options.AddString("TILED=YES");
  options.AddString("COMPRESS=DEFLATE");
  options.AddString((std::string("PREDICTOR=") + predictor).c_str());
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
  if (driver == nullptr) throw std::runtime_error("this GDAL writes no GeoTIFF");
  GDALDatasetUniquePtr dataset(
      driver->Create(name.c_str(), raster.width, raster.height, bands, type, options.List()));
  if (!dataset) throw std::runtime_error(std::string("GDAL: ") + CPLGetLastErrorMsg());
  OGRSpatialReference reference;
  if (reference.importFromEPSG(raster.epsg) != OGRERR_NONE)
    throw std::runtime_error("PROJ's database does not know EPSG:" + std::to_string(raster.epsg));
  checkGdal(dataset->SetSpatialRef(&reference));
  std::array<double, 6> transform{raster.west, raster.pixel, 0, raster.north, 0, -raster.pixel};
  checkGdal(dataset->SetGeoTransform(transform.data()));
  write(*dataset);
  dataset.reset();
  vsi_l_offset size = 0;
  const std::unique_ptr<GByte, decltype(&VSIFree)> bytes(VSIGetMemFileBuffer(name.c_str(), &size, TRUE),
                                                         &VSIFree);
  if (!bytes) throw std::runtime_error("GDAL wrote nothing");
  return {reinterpret_cast<const char*>(bytes.get()), static_cast<std::size_t>(size)};
}

// GDAL takes what it only reads through a pointer to non-const.
void* readOnly(const void* data) {
  return const_cast<void*>(data);
}

constexpr const char* kNoOrigin =
    "the mission's origin has not arrived yet, so nothing can be placed on the Earth";

std::string plyOf(ModelView& view) {
  std::vector<std::string> comments{"nav frame: x north, y east, z down [m]",
                                    "as received over the acoustic link"};
  if (const auto& mission = view.mission()) {
    std::ostringstream origin;
    origin.precision(10);
    origin << "origin " << mission->origin.latitude / kRadiansPerDegree << ' '
           << mission->origin.longitude / kRadiansPerDegree << " deg WGS84, local transverse Mercator";
    comments.push_back(origin.str());
  }
  std::ostringstream out;
  writePly(out, view.surface().whole(), comments);
  return std::move(out).str();
}

}  // namespace

int epsgOf(const Geodetic& origin) {
  const double latitude = origin.latitude / kRadiansPerDegree;
  constexpr double kUtmNorth = 84, kUtmSouth = -80;  // bounds of UTM [deg]
  constexpr int kUpsNorth = 32661, kUpsSouth = 32761;
  if (latitude > kUtmNorth) return kUpsNorth;
  if (latitude < kUtmSouth) return kUpsSouth;
  return (latitude < 0 ? 32700 : 32600) + utmZone(origin.longitude);
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
    throw std::runtime_error("PROJ has no transformation to EPSG:" + std::to_string(raster.epsg));

  // Bounds of the map in the projection: its extreme points are on the border of the rectangle in nav.
  double west = 1e12, east = -1e12, south = 1e12, north = -1e12;
  constexpr int kBorder = 8;  // points a side
  for (int i = 0; i <= kBorder; ++i) {
    const double n = bounds.north0 + (bounds.north1 - bounds.north0) * i / kBorder;
    const double e = bounds.east0 + (bounds.east1 - bounds.east0) * i / kBorder;
    for (const Eigen::Vector2d& p : {Eigen::Vector2d(n, bounds.east0), Eigen::Vector2d(n, bounds.east1),
                                     Eigen::Vector2d(bounds.north0, e), Eigen::Vector2d(bounds.north1, e)}) {
      const Geodetic g = local.toGeodetic(p);
      double x = g.longitude / kRadiansPerDegree, y = g.latitude / kRadiansPerDegree;
      if (!to_map->Transform(1, &x, &y)) throw std::runtime_error("the map is outside its projection");
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
        const int right = k % 2, below = k / 2;
        double x = raster.west + (column + right * kPatch) * raster.pixel;
        double y = raster.north - (row + below * kPatch) * raster.pixel;
        if (!from_map->Transform(1, &x, &y)) throw std::runtime_error("the map is outside its projection");
        corners[static_cast<std::size_t>(k)] = local.toLocal({y * kRadiansPerDegree, x * kRadiansPerDegree});
      }
      fillPatch(raster, row, column, surface, corners);
    }
  }
  return raster;
}

std::string elevationTiff(const GeoRaster& raster) {
  return tiff(raster, 1, GDT_Float32, "3", [&](GDALDataset& dataset) {
    GDALRasterBand* band = dataset.GetRasterBand(1);
    band->SetDescription("elevation above the sea surface");
    band->SetUnitType("m");
    checkGdal(band->SetNoDataValue(std::numeric_limits<double>::quiet_NaN()));
    checkGdal(band->RasterIO(GF_Write, 0, 0, raster.width, raster.height, readOnly(raster.elevation.data()),
                             raster.width, raster.height, GDT_Float32, 0, 0, nullptr));
  });
}

std::string colourTiff(const GeoRaster& raster) {
  return tiff(raster, 4, GDT_Byte, "2", [&](GDALDataset& dataset) {
    constexpr std::array<GDALColorInterp, 4> kMeaning{GCI_RedBand, GCI_GreenBand, GCI_BlueBand,
                                                      GCI_AlphaBand};
    for (int band = 0; band < 4; ++band)
      checkGdal(
          dataset.GetRasterBand(band + 1)->SetColorInterpretation(kMeaning[static_cast<std::size_t>(band)]));
    checkGdal(dataset.RasterIO(GF_Write, 0, 0, raster.width, raster.height, readOnly(raster.colour.data()),
                               raster.width, raster.height, GDT_Byte, 4, nullptr, 4,
                               GSpacing{4} * raster.width, 1, nullptr));
  });
}

std::string trackGeoJson(const ModelView& view) {
  if (!view.mission() || view.track().empty()) return {};
  const LocalTransverseMercator projection(view.mission()->origin);
  const auto position = [&](const TrackRecord& p) {
    const Geodetic g = projection.toGeodetic({p.north, p.east});
    return ordered_json{g.longitude / kRadiansPerDegree, g.latitude / kRadiansPerDegree, -p.depth};
  };
  ordered_json line = ordered_json::array(), times = ordered_json::array();
  for (const auto& [utc_ns, p] : view.track()) {
    line.push_back(position(p));
    times.push_back(static_cast<double>(utc_ns) * 1e-9);
  }
  ordered_json features = ordered_json::array();
  const auto identity = view.identity();
  const ordered_json last_position = line.back();
  // GeoJSON wants at least two positions in a line.
  if (line.size() > 1)
    features.push_back({{"type", "Feature"},
                        {"properties", {{"name", "track"}, {"utc_s", times}}},
                        {"geometry", {{"type", "LineString"}, {"coordinates", line}}}});
  features.push_back({{"type", "Feature"},
                      {"properties",
                       {{"name", view.mission()->vehicle_name},
                        {"vehicle_id", identity.vehicle_id},
                        {"dive_id", identity.dive_id},
                        {"utc_s", times.back()}}},
                      {"geometry", {{"type", "Point"}, {"coordinates", last_position}}}});
  return ordered_json{{"type", "FeatureCollection"}, {"features", features}}.dump(1) + "\n";
}

Export makeExport(ModelView& view, std::string_view name) {
  Export out;
  if (name == "track.geojson") {
    out.type = "application/geo+json";
    out.bytes = trackGeoJson(view);
    if (out.bytes.empty()) out.why = view.mission() ? "no position has arrived yet" : kNoOrigin;
    return out;
  }
  if (view.store().size() == 0) {
    out.why = "no map has arrived yet";
    return out;
  }
  if (name == "map.ply") {
    out.bytes = plyOf(view);
    return out;
  }
  if (!view.mission()) {
    out.why = kNoOrigin;
    return out;
  }
  out.type = "image/tiff";
  const auto raster = rasterOf(view.store(), view.surface(), view.mission()->origin);
  if (!raster) {
    out.why = "the map has no surface yet";
    return out;
  }
  out.bytes = name == "elevation.tif" ? elevationTiff(*raster) : colourTiff(*raster);
  return out;
}

void ExportFiles::save(ModelView& view) {
  trouble_.clear();
  const bool origin = view.mission().has_value();
  const bool all = origin != saved_origin_ || view.epoch() != saved_epoch_;
  const bool map = all || view.store().version() != saved_map_;
  const bool track = all || view.track().size() != saved_track_;
  try {
    for (const std::string_view name : kExportNames) {
      if (!(name == "track.geojson" ? track : map)) continue;
      const Export file = makeExport(view, name);
      if (!file.bytes.empty()) writeFile(folder_ / name, file.bytes);
    }
  } catch (const std::exception& error) {
    trouble_ = error.what();
    return;
  }
  saved_epoch_ = view.epoch();
  saved_map_ = view.store().version();
  saved_track_ = view.track().size();
  saved_origin_ = origin;
}

}  // namespace fathom::monitor
