#include "recon/products/exports/orthomosaic.hpp"

#include <cpl_string.h>
#include <gdal_utils.h>
#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "realtime/base/text.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/products/exports/gdal_files.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/rasters/srgb_profile.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kBands = 4;

// Texel centres stand at half steps; the last row is t = 0.
std::array<double, 3> texelAt(const RgbImage& atlas, double s, double t) {
  const double x = std::clamp(s * atlas.width - 0.5, 0.0, atlas.width - 1.0),
               y = std::clamp((1 - t) * atlas.height - 0.5, 0.0, atlas.height - 1.0);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, atlas.width - 1), y1 = std::min(y0 + 1, atlas.height - 1);
  const auto at = [&](int i, int j, std::size_t c) {
    return static_cast<double>(
        atlas.rgb[(static_cast<std::size_t>(j) * static_cast<std::size_t>(atlas.width) +
                   static_cast<std::size_t>(i)) *
                      3 +
                  c]);
  };
  std::array<double, 3> out{};
  for (std::size_t c = 0; c < 3; ++c)
    out[c] = (1 - (y - y0)) * ((1 - (x - x0)) * at(x0, y0, c) + (x - x0) * at(x1, y0, c)) +
             (y - y0) * ((1 - (x - x0)) * at(x0, y1, c) + (x - x0) * at(x1, y1, c));
  return out;
}

// The uppermost surface of a tile, whose north-west corner is given, in cells x cells of `cell` metres.
std::vector<std::uint8_t> drawn(const TexturedTile& tile, double north, double west, int cells, double cell) {
  const auto count = static_cast<std::size_t>(cells) * static_cast<std::size_t>(cells);
  std::vector<std::uint8_t> out(count * kBands, 0);
  std::vector<float> nearest(count, std::numeric_limits<float>::infinity());
  const Mesh& mesh = tile.surface.mesh;
  const bool textured = !tile.atlas.empty() && !mesh.texture_coordinates.empty();
  if (!textured && mesh.colours.empty()) return out;
  for (const auto& t : mesh.triangles) {
    std::array<Eigen::Vector2d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d v = mesh.vertices[t[k]].cast<double>();
      p[k] = {(north - v.x()) / cell - 0.5, (v.y() - west) / cell - 0.5};
    }
    scanTriangle(p, cells, cells, [&](int row, int column, const std::array<double, 3>& share) {
      double depth = 0;
      for (std::size_t k = 0; k < 3; ++k) depth += share[k] * static_cast<double>(mesh.vertices[t[k]].z());
      const std::size_t at =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(cells) + static_cast<std::size_t>(column);
      if (static_cast<float>(depth) >= nearest[at]) return;
      nearest[at] = static_cast<float>(depth);
      std::array<double, 3> colour{};
      if (textured) {
        Eigen::Vector2d st = Eigen::Vector2d::Zero();
        for (std::size_t k = 0; k < 3; ++k)
          st += share[k] * mesh.texture_coordinates[t[k]].template cast<double>();
        colour = texelAt(tile.atlas, st.x(), st.y());
      } else {
        for (std::size_t k = 0; k < 3; ++k)
          for (std::size_t c = 0; c < 3; ++c) colour[c] += share[k] * mesh.colours[t[k]][c];
      }
      for (std::size_t c = 0; c < 3; ++c)
        out[at * kBands + c] = static_cast<std::uint8_t>(std::lround(colour[c]));
      out[at * kBands + 3] = 255;
    });
  }
  return out;
}

}  // namespace

void drawTilesFromAbove(const std::filesystem::path& path, const std::filesystem::path& results) {
  const std::filesystem::path folder = results / "tiles";
  const std::vector<TileId> tiles = tilesOfLevel(folder, 0);
  if (tiles.empty())
    throw InputError(folder.string(), "level 0", "has no tiles; name a run's mission or results");
  const TileSource source = glbSource(folder);
  const ReadTile first = source(tiles.front());
  const double edge = first.grid.edge(0),
               texel = first.tile.texel > 0 ? first.tile.texel : first.grid.voxel / 4;
  const int cells = std::max(1, static_cast<int>(std::lround(edge / texel)));
  const double cell = edge / cells;
  TileRange range{tiles[0].x, tiles[0].y, tiles[0].x + 1, tiles[0].y + 1};
  for (const TileId& id : tiles)
    range = {std::min(range.x0, id.x), std::min(range.y0, id.y), std::max(range.x1, id.x + 1),
             std::max(range.y1, id.y + 1)};
  const double top = range.x1 * edge, left = range.y0 * edge;

  const double rows = static_cast<double>(range.x1 - range.x0) * cells,
               columns = static_cast<double>(range.y1 - range.y0) * cells;
  constexpr double kMost = 2e9;  // of GDAL's whole numbers
  if (rows > kMost || columns > kMost)
    throw InputError(folder.string(), "level 0", "spans more than an image can hold; is a part far away?");
  CPLStringList create;
  for (const auto& [key, value] : {std::pair("TILED", "YES"),
                                   {"COMPRESS", "DEFLATE"},
                                   {"ZLEVEL", "1"},
                                   {"SPARSE_OK", "TRUE"},
                                   {"BIGTIFF", "IF_SAFER"},
                                   {"ALPHA", "YES"}})
    create.SetNameValue(key, value);
  const DatasetPtr file(GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
      path.c_str(), static_cast<int>(columns), static_cast<int>(rows), static_cast<int>(kBands), GDT_Byte,
      create.List()));
  if (!file) gdalFailed(path);
  std::array<double, 6> grid{left, cell, 0, top, 0, -cell};
  file->SetGeoTransform(grid.data());
  file->SetProjection(frameOf(results).wkt.c_str());

  rt::StageProgress progress("orthomosaic", tiles.size());
  std::mutex one;
  bool failed = false;
  oneapi::tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t k) {
    const TileId& id = tiles[k];
    std::vector<std::uint8_t> block = drawn(source(id).tile, (id.x + 1) * edge, id.y * edge, cells, cell);
    const std::lock_guard lock(one);
    failed = failed || file->RasterIO(GF_Write, (id.y - range.y0) * cells, (range.x1 - 1 - id.x) * cells,
                                      cells, cells, block.data(), cells, cells, GDT_Byte, kBands, nullptr,
                                      kBands, static_cast<GSpacing>(kBands) * cells, 1) != CE_None;
    progress.step();
  });
  if (failed) gdalFailed(path);
}

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
