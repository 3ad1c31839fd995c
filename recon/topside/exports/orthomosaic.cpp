#include "recon/topside/exports/orthomosaic.hpp"

#include <gdal_utils.h>

#include <vector>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/text.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/topside/exports/gdal_files.hpp"
#include "recon/topside/exports/tiles_from_above.hpp"

namespace fathom::topside {
namespace {

using WarpOptions = std::unique_ptr<GDALWarpAppOptions, void (*)(GDALWarpAppOptions*)>;

// As gdalwarp's command line has them.
WarpOptions warpOptions(std::vector<std::string> words) {
  std::vector<char*> list;
  for (std::string& word : words) list.push_back(word.data());
  list.push_back(nullptr);
  return {GDALWarpAppOptionsNew(list.data(), nullptr), GDALWarpAppOptionsFree};
}

}  // namespace

void writeOrthomosaic(const std::filesystem::path& path, const std::filesystem::path& results,
                      const OrthomosaicConfig& config) {
  const compare::PlaneFrame frame = compare::frameFrom(config.crs, "--crs");
  const GdalUse gdal;
  GdalTarget target(path);
  const GdalTarget own(path.string() + ".own.tif");  // in the dive's own system; removed at the end
  drawTilesFromAbove(own.temporary(), results);
  const DatasetPtr mosaic(static_cast<GDALDataset*>(GDALOpen(own.temporary().c_str(), GA_ReadOnly)));
  if (!mosaic) gdalFailed(own.temporary());
  std::vector<std::string> words = {"-of", "VRT", "-t_srs", frame.wkt, "-r", "cubic"};
  if (config.cell > 0) {
    const std::string cell = formatted("%.17g", config.cell);
    words.insert(words.end(), {"-tr", cell, cell});
  }
  GDALDatasetH source = mosaic.get();
  int failed = 0;
  // Virtual: cells are made as the file asks for them.
  const DatasetPtr warped(
      static_cast<GDALDataset*>(GDALWarp("", nullptr, 1, &source, warpOptions(words).get(), &failed)));
  if (!warped || failed != 0) gdalFailed(path);
  CPLStringList create;
  create.SetNameValue("COMPRESS", config.lossless ? "DEFLATE" : "JPEG");
  create.SetNameValue(config.lossless ? "PREDICTOR" : "QUALITY", config.lossless ? "YES" : "85");
  create.SetNameValue("BIGTIFF", "IF_SAFER");
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("COG");
  if (driver == nullptr) throw std::runtime_error("this GDAL writes no cloud-optimised GeoTIFFs");
  DatasetPtr written(driver->CreateCopy(target.temporary().c_str(), warped.get(), FALSE, create.List(),
                                        GDALDummyProgress, nullptr));
  if (!written) gdalFailed(path);
  CPLErrorReset();
  written.reset();  // which writes the rest
  if (CPLGetLastErrorType() == CE_Failure) gdalFailed(path);
  target.commit();
}

}  // namespace fathom::topside
