#include "recon/products/exports/survey_geopackage.hpp"

#include <gdal_alg.h>
#include <ogrsf_frmts.h>

#include <Eigen/Geometry>
#include <cmath>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/products/exports/gdal_files.hpp"
#include "recon/products/exports/results_files.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using JsonTree = nlohmann::json;

constexpr double kMostContours = 20;

struct Field {
  const char* name;
  OGRFieldType type;
};

void setTime(OGRFeature& feature, const char* field, const JsonTree& utc_ns) {
  if (!utc_ns.is_string()) return;
  const io::CivilTime t = io::civilFromUtc(std::stoll(utc_ns.get<std::string>()));
  feature.SetField(field, formatted("%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", t.year, t.month, t.day, t.hour,
                                    t.minute, t.second, t.nanosecond / 1'000'000)
                              .c_str());
}

// The package that is being written: layers in one system, features given in the dive's own.
class Package {
 public:
  Package(const fs::path& path, const std::string& crs, const compare::PlaneFrame& own)
      : path_(path), to_crs_(own, frameNamed(crs)) {
    if (crs.empty())
      srs_.SetLocalCS("Undefined Cartesian SRS");  // as GeoPackages name it
    else
      srs_.SetFromUserInput(crs.c_str());
    srs_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("GPKG");
    if (driver == nullptr) throw std::runtime_error("this GDAL writes no GeoPackages");
    file_.reset(driver->Create(path.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
    if (!file_) gdalFailed(path);
  }
  OGRLayer& layer(const char* name, OGRwkbGeometryType type, std::initializer_list<Field> fields) {
    OGRLayer* layer = file_->CreateLayer(name, &srs_, type, nullptr);
    if (layer == nullptr) gdalFailed(path_);
    for (const Field& field : fields) {
      OGRFieldDefn definition(field.name, field.type);
      if (layer->CreateField(&definition) != OGRERR_NONE) gdalFailed(path_);
    }
    if (layer->StartTransaction() != OGRERR_NONE) gdalFailed(path_);
    return *layer;
  }
  // Appends places of the dive, east and north, to a line or ring.
  void extend(OGRSimpleCurve& line, std::vector<double> east, std::vector<double> north,
              const std::vector<double>& up) const {
    to_crs_.apply(east, north);
    for (std::size_t k = 0; k < east.size(); ++k) {
      if (!std::isfinite(east[k])) throw InputError("--crs", "", "does not reach where the dive was");
      if (up.empty())
        line.addPoint(east[k], north[k]);
      else
        line.addPoint(east[k], north[k], up[k]);
    }
  }
  void add(OGRLayer& layer, OGRFeature& feature, const OGRGeometry& shape) const {
    feature.SetGeometry(&shape);
    if (layer.CreateFeature(&feature) != OGRERR_NONE) gdalFailed(path_);
  }
  void end(OGRLayer& layer) const {
    if (layer.CommitTransaction() != OGRERR_NONE) gdalFailed(path_);
  }
  void close() {
    CPLErrorReset();
    file_.reset();
    if (CPLGetLastErrorType() == CE_Failure) gdalFailed(path_);
  }

 private:
  fs::path path_;
  compare::PlaneTransform to_crs_;
  OGRSpatialReference srs_;
  DatasetPtr file_;
};

std::size_t addFootprints(Package& package, const JsonTree& images) {
  OGRLayer& layer = package.layer("footprints", wkbPolygon,
                                  {{"left", OFTString},
                                   {"right", OFTString},
                                   {"utc", OFTDateTime},
                                   {"altitude_m", OFTReal},
                                   {"depth_m", OFTReal},
                                   {"heading_deg", OFTReal}});
  std::size_t count = 0;
  for (const JsonTree& image : images.at("images")) {
    std::vector<double> east, north;
    for (const JsonTree& corner : image.at("footprint")) {
      north.push_back(corner.at(0).get<double>());
      east.push_back(corner.at(1).get<double>());
    }
    if (east.empty()) continue;
    OGRLinearRing ring;
    package.extend(ring, east, north, {});
    ring.closeRings();
    OGRPolygon polygon;
    polygon.addRing(&ring);
    const auto q = image.at("q").get<std::array<double, 4>>();
    const Eigen::Vector3d top = Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * -Eigen::Vector3d::UnitY();
    const double heading = std::atan2(top.y(), top.x()) * kDegreesPerRadian;
    OGRFeature feature(layer.GetLayerDefn());
    feature.SetField("left", image.at("left").get<std::string>().c_str());
    feature.SetField("right", image.at("right").get<std::string>().c_str());
    setTime(feature, "utc", image.at("utc_ns"));
    if (image.at("altitude").is_number()) feature.SetField("altitude_m", image["altitude"].get<double>());
    feature.SetField("depth_m", image.at("depth").get<double>());
    feature.SetField("heading_deg", heading < 0 ? heading + 360 : heading);
    package.add(layer, feature, polygon);
    ++count;
  }
  package.end(layer);
  return count;
}

void addTrack(Package& package, const JsonTree& track) {
  OGRLayer* layer = nullptr;
  const std::size_t count = track.at("north").size();
  const bool timed = track.value("timed", true);
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<double> east, north, up;
    const std::size_t first = k;
    for (; k < count && track["north"][k].is_number(); ++k) {
      north.push_back(track["north"][k].get<double>());
      east.push_back(track.at("east").at(k).get<double>());
      up.push_back(-track.at("depth").at(k).get<double>());
    }
    if (north.size() < 2) continue;
    if (layer == nullptr)
      layer =
          &package.layer("track", wkbLineString25D, {{"begin_utc", OFTDateTime}, {"end_utc", OFTDateTime}});
    OGRLineString line;
    package.extend(line, east, north, up);
    OGRFeature feature(layer->GetLayerDefn());
    if (timed) {
      setTime(feature, "begin_utc", track.at("utc_ns").at(first));
      setTime(feature, "end_utc", track["utc_ns"].at(k - 1));
    }
    package.add(*layer, feature, line);
  }
  if (layer != nullptr) package.end(*layer);
}

// 1, 2 or 5 times a power of ten.
double intervalFor(double range) {
  double step = std::pow(10, std::floor(std::log10(std::max(range, 1e-3) / kMostContours)));
  for (const double factor : {2.0, 2.5, 2.0})
    if (range / step > kMostContours) step *= factor;
  return step;
}

std::size_t addContours(Package& package, const fs::path& raster, double interval) {
  const DatasetPtr file(static_cast<GDALDataset*>(GDALOpen(raster.c_str(), GA_ReadOnly)));
  if (!file) return 0;
  GDALRasterBand* band = file->GetRasterBand(1);
  std::array<double, 2> range{};
  if (band->ComputeRasterMinMax(0, range.data()) != CE_None) gdalFailed(raster);
  if (interval <= 0) interval = intervalFor(range[1] - range[0]);
  // In the raster's own plane first, which is the dive's.
  const DatasetPtr memory(
      GetGDALDriverManager()->GetDriverByName("Memory")->Create("", 0, 0, 0, GDT_Unknown, nullptr));
  OGRLayer* drawn = memory->CreateLayer("contours", nullptr, wkbLineString, nullptr);
  OGRFieldDefn height("height_m", OFTReal);
  if (drawn->CreateField(&height) != OGRERR_NONE) gdalFailed(raster);
  if (GDALContourGenerate(band, interval, 0, 0, nullptr, TRUE, std::nan(""), drawn, -1, 0, nullptr,
                          nullptr) != CE_None)
    gdalFailed(raster);
  OGRLayer& layer = package.layer("contours", wkbLineString, {{"height_m", OFTReal}});
  std::size_t count = 0;
  for (const auto& from : *drawn) {
    const OGRLineString& line = *from->GetGeometryRef()->toLineString();
    std::vector<double> east, north;
    for (int k = 0; k < line.getNumPoints(); ++k) {
      east.push_back(line.getX(k));
      north.push_back(line.getY(k));
    }
    OGRLineString moved;
    package.extend(moved, east, north, {});
    OGRFeature feature(layer.GetLayerDefn());
    feature.SetField("height_m", from->GetFieldAsDouble(0));
    package.add(layer, feature, moved);
    ++count;
  }
  package.end(layer);
  return count;
}

}  // namespace

GeopackageCounts writeSurveyGeopackage(const fs::path& path, const fs::path& results, const std::string& crs,
                                       double interval) {
  const GdalUse gdal;
  const JsonTree images = readResultJson(results / "images.json"),
                 track = readResultJson(results / "track.json");
  GdalTarget target(path);
  Package package(target.temporary(), crs, frameOf(results));
  GeopackageCounts counts;
  try {
    counts.footprints = addFootprints(package, images);
    addTrack(package, track);
  } catch (const JsonTree::exception& error) {
    throw InputError(results.string(), "images.json, track.json",
                     std::string("not as a run writes them: ") + error.what());
  }
  counts.contours = addContours(package, results / "layers" / "elevation.tif", interval);
  package.close();
  target.commit();
  return counts;
}

}  // namespace fathom::topside
