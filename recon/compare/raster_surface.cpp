#include <gdal_priv.h>
#include <gdal_utils.h>
#include <gdalwarper.h>

#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/compare/surface_file.hpp"

namespace fathom::compare {
namespace {

using Dataset = GDALDatasetUniquePtr;

Dataset openQuietly(const std::filesystem::path& path) {
  GDALAllRegister();
  CPLPushErrorHandler(CPLQuietErrorHandler);
  Dataset dataset(GDALDataset::FromHandle(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, nullptr, nullptr, nullptr)));
  CPLPopErrorHandler();
  return dataset;
}

std::string number(double value) {
  return formatted("%.12g", value);
}

class RasterSurface final : public SurfaceFile {
 public:
  RasterSurface(const std::filesystem::path& path, const std::string& crs)
      : path_(path), dataset_(openQuietly(path)) {
    if (!dataset_ || dataset_->GetRasterCount() < 1)
      throw InputError(path.string(), "",
                       "is no raster that can be read; give a GeoTIFF, or text with x y z as .xyz");
    double t[6];
    if (dataset_->GetGeoTransform(t) != CE_None)
      throw InputError(path.string(), "", "does not state its position (no geotransform)");
    const char* wkt = dataset_->GetProjectionRef();
    if (!crs.empty())
      frame_ = frameFrom(crs, "--reference-crs");
    else if (wkt != nullptr && *wkt != '\0')
      frame_ = frameFrom(wkt, path.string());
    const auto beside = path.parent_path() / "uncertainty.tif";
    std::error_code error;
    if (path.filename() == "elevation.tif" && std::filesystem::exists(beside, error))
      sigma_ = openQuietly(beside);
    about_ = "raster of " + std::to_string(dataset_->GetRasterXSize()) + " x " +
             std::to_string(dataset_->GetRasterYSize()) + " pixels";
  }

  PlaneFrame frame() const override { return frame_; }

  Box bounds(const PlaneFrame& to) const override { return PlaneTransform(frame_, to).apply(ownBox()); }

  double spacing(const PlaneFrame& to) const override {
    const Box box = bounds(to);
    const double pixels = static_cast<double>(dataset_->GetRasterXSize()) * dataset_->GetRasterYSize();
    return std::sqrt((box.east - box.west) * (box.north - box.south) / pixels);
  }

  HeightMap read(const PlaneFrame& to, const Box& box, double cell) const override {
    HeightMap map(box, cell);
    const bool finer = cell > 1.5 * spacing(to);
    map.up = warped(*dataset_, to, map, finer);
    if (sigma_) map.sigma = warped(*sigma_, to, map, finer);
    return map;
  }

 private:
  Box ownBox() const {
    double t[6];
    dataset_->GetGeoTransform(t);
    Box box{INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (const int x : {0, dataset_->GetRasterXSize()}) {
      for (const int y : {0, dataset_->GetRasterYSize()}) {
        const double east = t[0] + x * t[1] + y * t[2], north = t[3] + x * t[4] + y * t[5];
        box = {std::min(box.west, east), std::min(box.south, north), std::max(box.east, east),
               std::max(box.north, north)};
      }
    }
    return box;
  }

  // Band 1 in the cells of `map`.
  std::vector<float> warped(GDALDataset& from, const PlaneFrame& to, const HeightMap& map,
                            bool average) const {
    const Box box = map.box();
    std::vector<std::string> words = {"-of",
                                      "MEM",
                                      "-ot",
                                      "Float32",
                                      "-dstnodata",
                                      "nan",
                                      "-r",
                                      average ? "average" : "bilinear",
                                      "-te",
                                      number(box.west),
                                      number(box.south),
                                      number(box.east),
                                      number(box.north),
                                      "-ts",
                                      std::to_string(map.columns),
                                      std::to_string(map.rows)};
    if (frame_.known() && to.known()) {
      words.insert(words.end(), {"-s_srs", frame_.wkt, "-t_srs", to.wkt});
    }
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    CPLPushErrorHandler(CPLQuietErrorHandler);
    CPLErrorReset();
    GDALWarpAppOptions* options = GDALWarpAppOptionsNew(arguments.data(), nullptr);
    GDALDatasetH source = GDALDataset::ToHandle(&from);
    int usage_error = 0;
    Dataset result(options == nullptr
                       ? nullptr
                       : GDALDataset::FromHandle(GDALWarp("", nullptr, 1, &source, options, &usage_error)));
    GDALWarpAppOptionsFree(options);
    const std::string why = CPLGetLastErrorMsg();
    CPLPopErrorHandler();
    std::vector<float> values(map.up.size(), std::numeric_limits<float>::quiet_NaN());
    if (!result ||
        result->GetRasterBand(1)->RasterIO(GF_Read, 0, 0, map.columns, map.rows, values.data(), map.columns,
                                           map.rows, GDT_Float32, 0, 0, nullptr) != CE_None)
      throw InputError(path_.string(), "", "cannot be brought into the survey's frame: " + why);
    return values;
  }

  std::filesystem::path path_;
  Dataset dataset_, sigma_;
  PlaneFrame frame_;
};

}  // namespace

std::unique_ptr<SurfaceFile> openRaster(const std::filesystem::path& path, const std::string& crs) {
  return std::make_unique<RasterSurface>(path, crs);
}

}  // namespace fathom::compare
