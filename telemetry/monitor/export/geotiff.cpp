#include <cpl_string.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <array>
#include <atomic>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>

#include "telemetry/monitor/export/geo_raster.hpp"

namespace fathom::monitor {
namespace {

struct Close {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};

void check(CPLErr result) {
  if (result != CE_None) throw std::runtime_error(std::string("GDAL: ") + CPLGetLastErrorMsg());
}

// Makes the file in memory: what becomes of the bytes is the caller's.
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
  std::unique_ptr<GDALDataset, Close> dataset(
      driver->Create(name.c_str(), raster.width, raster.height, bands, type, options.List()));
  if (!dataset) throw std::runtime_error(std::string("GDAL: ") + CPLGetLastErrorMsg());
  OGRSpatialReference reference;
  if (reference.importFromEPSG(raster.epsg) != OGRERR_NONE)
    throw std::runtime_error("PROJ's database does not know EPSG:" + std::to_string(raster.epsg));
  check(dataset->SetSpatialRef(&reference));
  std::array<double, 6> transform{raster.west, raster.pixel, 0, raster.north, 0, -raster.pixel};
  check(dataset->SetGeoTransform(transform.data()));
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

}  // namespace

std::string elevationTiff(const GeoRaster& raster) {
  return tiff(raster, 1, GDT_Float32, "3", [&](GDALDataset& dataset) {
    GDALRasterBand* band = dataset.GetRasterBand(1);
    band->SetDescription("elevation above the sea surface");
    band->SetUnitType("m");
    check(band->SetNoDataValue(std::numeric_limits<double>::quiet_NaN()));
    check(band->RasterIO(GF_Write, 0, 0, raster.width, raster.height, readOnly(raster.elevation.data()),
                         raster.width, raster.height, GDT_Float32, 0, 0, nullptr));
  });
}

std::string colourTiff(const GeoRaster& raster) {
  return tiff(raster, 4, GDT_Byte, "2", [&](GDALDataset& dataset) {
    constexpr std::array<GDALColorInterp, 4> kMeaning{GCI_RedBand, GCI_GreenBand, GCI_BlueBand,
                                                      GCI_AlphaBand};
    for (int band = 0; band < 4; ++band)
      check(
          dataset.GetRasterBand(band + 1)->SetColorInterpretation(kMeaning[static_cast<std::size_t>(band)]));
    check(dataset.RasterIO(GF_Write, 0, 0, raster.width, raster.height, readOnly(raster.colour.data()),
                           raster.width, raster.height, GDT_Byte, 4, nullptr, 4, GSpacing{4} * raster.width,
                           1, nullptr));
  });
}

}  // namespace fathom::monitor
