#include "recon/products/rasters/raster_reading.hpp"

#include <gdal_priv.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <stdexcept>

namespace fathom::topside {
namespace {

struct CloseDataset {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using DatasetPtr = std::unique_ptr<GDALDataset, CloseDataset>;

[[noreturn]] void refuse(const std::filesystem::path& path) {
  throw std::runtime_error(path.string() + ": " + CPLGetLastErrorMsg());
}

}  // namespace

ReducedRaster readReduced(const std::filesystem::path& path, int pixels) {
  static std::once_flag once;
  std::call_once(once, GDALAllRegister);
  CPLPushErrorHandler(CPLQuietErrorHandler);  // errors become exceptions
  const std::unique_ptr<void, void (*)(void*)> pop(&once, [](void*) { CPLPopErrorHandler(); });
  CPLErrorReset();
  const DatasetPtr file(static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly)));
  if (!file) refuse(path);
  const int width = file->GetRasterXSize(), height = file->GetRasterYSize();
  std::array<double, 6> transform{};
  file->GetGeoTransform(transform.data());
  ReducedRaster out;
  const double factor = std::max(1.0, static_cast<double>(std::max(width, height)) / pixels);
  out.width = std::max(1, static_cast<int>(std::lround(width / factor)));
  out.height = std::max(1, static_cast<int>(std::lround(height / factor)));
  out.pixel = transform[1] * width / out.width;
  out.west = transform[0];
  out.north = transform[3];
  const auto cells = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  CPLErr error = CE_None;
  if (file->GetRasterCount() == 4) {
    out.rgba.resize(4 * cells);
    GDALRasterIOExtraArg how;
    INIT_RASTERIO_EXTRA_ARG(how);
    how.eResampleAlg = GRIORA_Average;
    error = file->RasterIO(GF_Read, 0, 0, width, height, out.rgba.data(), out.width, out.height, GDT_Byte, 4,
                           nullptr, 4, 4 * static_cast<GSpacing>(out.width), 1, &how);
  } else {
    out.values.resize(cells);
    error = file->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, width, height, out.values.data(), out.width,
                                             out.height, GDT_Float32, 0, 0, nullptr);
  }
  if (error != CE_None) refuse(path);
  return out;
}

}  // namespace fathom::topside
