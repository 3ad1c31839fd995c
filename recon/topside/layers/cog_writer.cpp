#include "recon/topside/layers/cog_writer.hpp"

#include <cpl_string.h>
#include <gdal_priv.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>

namespace fathom::topside {
namespace {

constexpr GIntBig kCacheBytes = GIntBig{128} << 20;  // of GDAL's blocks; bounds memory

void setUpGdal() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALAllRegister();
    GDALSetCacheMax64(kCacheBytes);
    CPLSetErrorHandler(CPLQuietErrorHandler);  // errors are told by exceptions
  });
}

[[noreturn]] void refuse(const std::filesystem::path& path) {
  throw std::runtime_error(path.string() + ": " + CPLGetLastErrorMsg());
}

// A source as GDAL sees it: north up, blocks as in the file to be made.
class SourceDataset final : public GDALDataset {
 public:
  SourceDataset(const RasterSource& source, const CogOptions& options);

  CPLErr GetGeoTransform(double* transform) override {
    transform[0] = source_.extent.y * source_.cell;
    transform[1] = source_.cell;
    transform[2] = 0;
    transform[3] = (source_.extent.x + source_.extent.rows) * source_.cell;
    transform[4] = 0;
    transform[5] = -source_.cell;
    return CE_None;
  }
  const OGRSpatialReference* GetSpatialRef() const override { return &reference_; }

  // The cells of a rectangle of the picture.
  [[nodiscard]] CellWindow window(int x, int y, int width, int height) const {
    return {source_.extent.x + source_.extent.rows - y - height, source_.extent.y + x, height, width};
  }
  [[nodiscard]] CellWindow block(int bx, int by) const {
    const int x = bx * kCogBlock, y = by * kCogBlock;
    return window(x, y, std::min(kCogBlock, nRasterXSize - x), std::min(kCogBlock, nRasterYSize - y));
  }
  [[nodiscard]] const RasterSource& source() const { return source_; }

 private:
  const RasterSource& source_;
  OGRSpatialReference reference_;
};

class SourceBand final : public GDALRasterBand {
 public:
  SourceBand(SourceDataset* dataset, int band, const CogOptions& options) : dataset_(dataset) {
    poDS = dataset;
    nBand = band;
    eDataType = dataset->source().colour ? GDT_Byte : GDT_Float32;
    nBlockXSize = nBlockYSize = kCogBlock;
    if (!dataset->source().colour) {
      SetDescription(options.description.c_str());
      unit_ = options.unit;
    }
  }

  const char* GetUnitType() override { return unit_.c_str(); }
  double GetNoDataValue(int* success) override {
    if (success != nullptr) *success = dataset_->source().colour ? FALSE : TRUE;
    return dataset_->source().colour ? 0 : std::numeric_limits<double>::quiet_NaN();
  }
  GDALColorInterp GetColorInterpretation() override {
    return dataset_->source().colour ? static_cast<GDALColorInterp>(GCI_RedBand + nBand - 1) : GCI_GrayIndex;
  }

 protected:
  CPLErr IReadBlock(int bx, int by, void* data) override {
    const CellWindow window = dataset_->block(bx, by);
    return dataset_->source().colour ? readColours(window, bx, by, data) : readValues(window, data);
  }

  int IGetDataCoverageStatus(int x, int y, int width, int height, int, double* share) override {
    const bool any = dataset_->source().touches(dataset_->window(x, y, width, height));
    if (share != nullptr) *share = any ? 100 : 0;
    return any ? GDAL_DATA_COVERAGE_STATUS_DATA : GDAL_DATA_COVERAGE_STATUS_EMPTY;
  }

 private:
  CPLErr readValues(const CellWindow& window, void* data) {
    auto* to = static_cast<float*>(data);
    std::fill(to, to + kCogBlock * kCogBlock, std::numeric_limits<float>::quiet_NaN());
    if (!dataset_->source().touches(window)) return CE_None;
    std::vector<float> cells(window.cells());
    dataset_->source().fill(window, cells.data());
    for (int row = 0; row < window.rows; ++row)
      std::copy_n(&cells[window.at(window.rows - 1 - row, 0)], window.columns, to + row * kCogBlock);
    return CE_None;
  }

  // All four bands at once: the others are laid into GDAL's cache.
  CPLErr readColours(const CellWindow& window, int bx, int by, void* data) {
    std::vector<std::uint8_t> rgba(4 * window.cells());
    const bool any = dataset_->source().touches(window);
    if (any) dataset_->source().fill(window, rgba.data());
    for (int band = 1; band <= 4; ++band) {
      auto* to = static_cast<std::uint8_t*>(data);
      GDALRasterBlock* locked = nullptr;
      if (band != nBand) {
        locked = dataset_->GetRasterBand(band)->GetLockedBlockRef(bx, by, TRUE);
        if (locked == nullptr) continue;
        to = static_cast<std::uint8_t*>(locked->GetDataRef());
      }
      std::memset(to, 0, static_cast<std::size_t>(kCogBlock) * kCogBlock);
      for (int row = 0; any && row < window.rows; ++row) {
        const std::uint8_t* from = &rgba[4 * window.at(window.rows - 1 - row, 0)];
        for (int column = 0; column < window.columns; ++column)
          to[row * kCogBlock + column] = from[4 * column + band - 1];
      }
      if (locked != nullptr) locked->DropLock();
    }
    return CE_None;
  }

  SourceDataset* dataset_;
  std::string unit_;
};

SourceDataset::SourceDataset(const RasterSource& source, const CogOptions& options) : source_(source) {
  nRasterXSize = source.extent.columns;
  nRasterYSize = source.extent.rows;
  reference_.importFromWkt(options.wkt.c_str());
  reference_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  for (int band = 1; band <= (source.colour ? 4 : 1); ++band)
    SetBand(band, new SourceBand(this, band, options));  // the dataset deletes it
}

struct CloseDataset {
  void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
};
using DatasetPtr = std::unique_ptr<GDALDataset, CloseDataset>;

}  // namespace

void writeCog(const std::filesystem::path& path, const RasterSource& source, const CogOptions& options) {
  setUpGdal();
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("COG");
  if (driver == nullptr) throw std::runtime_error("this GDAL has no COG driver (3.1 or later has)");
  const bool lossy = source.colour && options.quality > 0;
  CPLStringList list;
  list.SetNameValue("BLOCKSIZE", std::to_string(kCogBlock).c_str());
  list.SetNameValue("COMPRESS", lossy ? "WEBP" : "DEFLATE");
  if (lossy) {
    list.SetNameValue("QUALITY", std::to_string(options.quality).c_str());
    list.SetNameValue("OVERVIEW_QUALITY", std::to_string(options.quality).c_str());
  } else {
    list.SetNameValue("PREDICTOR", "YES");
    list.SetNameValue("OVERVIEW_PREDICTOR", "YES");
  }
  list.SetNameValue("RESAMPLING", options.average ? "AVERAGE" : "NEAREST");
  list.SetNameValue("SPARSE_OK", "TRUE");
  list.SetNameValue("BIGTIFF", "IF_SAFER");
  list.SetNameValue("NUM_THREADS", std::to_string(std::max(1, options.threads)).c_str());
  CPLErrorReset();
  SourceDataset dataset(source, options);
  const DatasetPtr written(
      driver->CreateCopy(path.c_str(), &dataset, FALSE, list.List(), GDALDummyProgress, nullptr));
  if (!written || CPLGetLastErrorType() >= CE_Failure) refuse(path);
}

ReducedRaster readReduced(const std::filesystem::path& path, int pixels) {
  setUpGdal();
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
    error = file->RasterIO(GF_Read, 0, 0, width, height, out.rgba.data(), out.width, out.height, GDT_Byte, 4,
                           nullptr, 4, 4 * static_cast<GSpacing>(out.width), 1, nullptr);
  } else {
    out.values.resize(cells);
    error = file->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, width, height, out.values.data(), out.width,
                                             out.height, GDT_Float32, 0, 0, nullptr);
  }
  if (error != CE_None) refuse(path);
  return out;
}

}  // namespace fathom::topside
