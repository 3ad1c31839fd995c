#include "sim/sea/ground/relief_raster.hpp"

#include <cpl_error.h>
#include <gdal_alg.h>
#include <gdal_priv.h>

#include <array>
#include <cmath>
#include <opencv2/core.hpp>

#include "realtime/base/input_error.hpp"

namespace fathom::sim {
namespace {

// A copy in memory of the first band, holes filled.
GDALDatasetUniquePtr filled(GDALDataset& file) {
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDatasetUniquePtr copy(memory->CreateCopy("", &file, 0, nullptr, nullptr, nullptr));
  if (!copy) return copy;
  GDALRasterBand* band = copy->GetRasterBand(1);
  constexpr double kFarthest = 1000;  // [cells]
  const CPLErr done =
      GDALFillNodata(GDALRasterBand::ToHandle(band), nullptr, kFarthest, 0, 0, nullptr, nullptr, nullptr);
  return done == CE_None ? std::move(copy) : nullptr;
}

}  // namespace

ReliefRaster::ReliefRaster(const std::filesystem::path& file, double cell_m) {
  GDALAllRegister();
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  const GDALDatasetUniquePtr source(GDALDataset::Open(file.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
  if (!source || source->GetRasterCount() < 1) throw InputError(file, "", "is no raster of heights");
  const GDALDatasetUniquePtr whole = filled(*source);
  columns_ = source->GetRasterXSize(), rows_ = source->GetRasterYSize();
  depths_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  if (!whole || whole->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, columns_, rows_, depths_.data(), columns_,
                                                  rows_, GDT_Float32, 0, 0) != CE_None)
    throw InputError(file, "", "cannot be read as heights");
  std::array<double, 6> transform{};
  const bool placed = source->GetGeoTransform(transform.data()) == CE_None;
  const double stated = placed ? std::hypot(transform[1], transform[2]) : cell_m;
  if (!(stated > 0))
    throw InputError(file, "", "does not state the size of its cells; give terrain.relief_cell_m");
  cell_m_ = cell_m > 0 ? cell_m : stated;
  double sum = 0;
  for (const float height : depths_) sum += static_cast<double>(height);
  const double mean = sum / static_cast<double>(depths_.size());
  if (!std::isfinite(mean)) throw InputError(file, "", "has cells without a height");
  for (float& d : depths_) d = static_cast<float>((mean - static_cast<double>(d)) * cell_m_ / stated);
}

double ReliefRaster::depthAt(double north_m, double east_m) const {
  const double row = 0.5 * (rows_ - 1) - north_m / cell_m_, column = 0.5 * (columns_ - 1) + east_m / cell_m_;
  const int r = static_cast<int>(std::floor(row)), c = static_cast<int>(std::floor(column));
  const double down = row - r, along = column - c;
  const auto at = [&](int i, int j) {
    const int y = cv::borderInterpolate(i, rows_, cv::BORDER_REFLECT_101),
              x = cv::borderInterpolate(j, columns_, cv::BORDER_REFLECT_101);
    return static_cast<double>(depths_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
                                       static_cast<std::size_t>(x)]);
  };
  return (1 - down) * ((1 - along) * at(r, c) + along * at(r, c + 1)) +
         down * ((1 - along) * at(r + 1, c) + along * at(r + 1, c + 1));
}

}  // namespace fathom::sim
