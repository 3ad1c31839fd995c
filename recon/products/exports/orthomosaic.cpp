#include "recon/products/exports/orthomosaic.hpp"

#include <cpl_string.h>
#include <gdal_utils.h>

#include <memory>
#include <string>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/products/exports/gdal_files.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/exports/tiles_from_above.hpp"
#include "recon/products/rasters/srgb_profile.hpp"

namespace fathom::topside {
namespace {

// A command line of GDAL's programs, as its functions take it.
class Words {
 public:
  explicit Words(std::vector<std::string> words) : words_(std::move(words)) {
    for (std::string& word : words_) list_.push_back(word.data());
    list_.push_back(nullptr);
  }
  [[nodiscard]] char** list() { return list_.data(); }

 private:
  std::vector<std::string> words_;
  std::vector<char*> list_;
};

// Virtual: cells are made as whoever reads them asks.
DatasetPtr warped(GDALDatasetH source, std::vector<std::string> words) {
  Words line(std::move(words));
  const std::unique_ptr<GDALWarpAppOptions, void (*)(GDALWarpAppOptions*)> options(
      GDALWarpAppOptionsNew(line.list(), nullptr), GDALWarpAppOptionsFree);
  int failed = 0;
  DatasetPtr out(static_cast<GDALDataset*>(GDALWarp("", nullptr, 1, &source, options.get(), &failed)));
  return failed == 0 ? std::move(out) : nullptr;
}

// Alpha as a mask, which JPEG keeps; the driver's own mask would lose the profile.
DatasetPtr masked(GDALDatasetH source) {
  Words line({"-of", "VRT", "-b", "1", "-b", "2", "-b", "3", "-mask", "4"});
  const std::unique_ptr<GDALTranslateOptions, void (*)(GDALTranslateOptions*)> options(
      GDALTranslateOptionsNew(line.list(), nullptr), GDALTranslateOptionsFree);
  int failed = 0;
  DatasetPtr out(static_cast<GDALDataset*>(GDALTranslate("", source, options.get(), &failed)));
  return failed == 0 ? std::move(out) : nullptr;
}

std::string base64(const std::vector<std::uint8_t>& bytes) {
  const std::unique_ptr<char, void (*)(void*)> text(
      CPLBase64Encode(static_cast<int>(bytes.size()), bytes.data()), VSIFree);
  return text.get();
}

}  // namespace

void writeOrthomosaic(const std::filesystem::path& path, const std::filesystem::path& results,
                      const OrthomosaicConfig& config) {
  const compare::PlaneFrame frame = frameNamed(config.crs);
  const GdalUse gdal;
  GdalTarget target(path);
  const GdalTarget own(path.string() + ".own.tif");  // in the dive's own system; removed at the end
  drawTilesFromAbove(own.temporary(), results);
  const DatasetPtr mosaic(static_cast<GDALDataset*>(GDALOpen(own.temporary().c_str(), GA_ReadOnly)));
  if (!mosaic) gdalFailed(own.temporary());
  std::vector<std::string> words = {"-of", "VRT", "-r", "cubic"};
  if (frame.known()) words.insert(words.end(), {"-t_srs", frame.wkt});
  if (config.cell > 0) {
    const std::string cell = formatted("%.17g", config.cell);
    words.insert(words.end(), {"-tr", cell, cell});
  }
  const DatasetPtr all = warped(mosaic.get(), std::move(words));
  if (!all) gdalFailed(path);
  const DatasetPtr drawn = config.lossless ? nullptr : masked(all.get());
  if (!config.lossless && !drawn) gdalFailed(path);
  GDALDataset& picture = drawn ? *drawn : *all;
  if (picture.SetMetadataItem("SOURCE_ICC_PROFILE", base64(srgbProfile()).c_str(), "COLOR_PROFILE") !=
      CE_None)
    gdalFailed(path);
  CPLStringList create;
  create.SetNameValue("COMPRESS", config.lossless ? "DEFLATE" : "JPEG");
  create.SetNameValue(config.lossless ? "PREDICTOR" : "QUALITY", config.lossless ? "YES" : "85");
  create.SetNameValue("BIGTIFF", "IF_SAFER");
  GDALDriver* driver = GetGDALDriverManager()->GetDriverByName("COG");
  if (driver == nullptr) throw std::runtime_error("this GDAL writes no cloud-optimised GeoTIFFs");
  DatasetPtr written(driver->CreateCopy(target.temporary().c_str(), &picture, FALSE, create.List(),
                                        GDALDummyProgress, nullptr));
  if (!written) gdalFailed(path);
  CPLErrorReset();
  written.reset();  // which writes the rest
  if (CPLGetLastErrorType() == CE_Failure) gdalFailed(path);
  target.commit();
}

}  // namespace fathom::topside
