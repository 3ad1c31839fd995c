#include "recon/products/rasters/layer_set.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/products/rasters/cog_writer.hpp"
#include "recon/products/rasters/layer_picture.hpp"
#include "recon/products/rasters/patch_mosaic.hpp"
#include "recon/products/rasters/terrain.hpp"
#include "recon/products/rasters/track_layers.hpp"

namespace fathom::topside {
namespace {

constexpr double kLegendTail = 0.02;  // of the values on either side are beyond the legend
constexpr int kLegendPixels = 1200;   // of the reduced raster that the legend is taken from

struct Layer {
  LayerInfo info;
  RasterSource source;
  bool average = true;
  bool shaded = false;
  double fixed_max = 0;  // of the legend; 0: from the values
  bool from_zero = false;
};

// To a power of ten that is small against the range; a decimal that prints short.
double outwards(double value, double range, bool up) {
  const double power = std::floor(std::log10(std::max(range, 1e-6))) - 1;
  const double step = std::pow(10.0, std::abs(power));
  const double steps = power < 0 ? value * step : value / step;
  const double whole = up ? std::ceil(steps) : std::floor(steps);
  return power < 0 ? whole / step : whole * step;
}

// The legend's ends; false when the raster holds no value.
bool legend(const ReducedRaster& raster, const Layer& layer, LayerInfo& info) {
  std::vector<float> values;
  for (const float v : raster.values)
    if (std::isfinite(v)) values.push_back(v);
  if (values.empty()) return false;
  const auto rank = [&](double share) {
    const auto place = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
    return static_cast<double>(ranked(std::span(values), place));
  };
  info.min = layer.from_zero ? 0 : rank(kLegendTail);
  info.max = layer.fixed_max > 0 ? layer.fixed_max : rank(1 - kLegendTail);
  if (layer.fixed_max > 0) return true;
  const double range = info.max - info.min;
  info.min = outwards(info.min, range, false);
  info.max = outwards(info.max, range, true);
  if (!(info.max > info.min)) info.max = info.min + 1;  // one value everywhere
  return true;
}

// What a value is rounded to: a power of two well below what it is worth, so that it deflates well.
constexpr float kHeightStep = 1.0F / 4096;  // [m]
constexpr float kDegreeStep = 1.0F / 64;    // [degrees]
constexpr float kRugosityStep = 1.0F / 8192;
constexpr float kWholeStep = 1;

float rounded(float value, float step) {
  return std::nearbyint(value / step) * step;
}

// Calculates in parts of a block, so that a track across it costs no more than its own ground.
constexpr std::int32_t kTerrainPart = 128;  // [cells]
template <typename Use>
void fillTerrain(PatchMosaic& mosaic, double cell, int radius, const Use& use, const CellWindow& whole,
                 const CellWindow& part, float* out) {
  if (part.cells() == 0 || !mosaic.touches(part, cell)) return;
  if (part.rows > kTerrainPart || part.columns > kTerrainPart) {
    const std::int32_t rows = part.rows / 2, columns = part.columns / 2;
    const std::array<CellWindow, 4> quarters = {
        {{part.x, part.y, rows, columns},
         {part.x, part.y + columns, rows, part.columns - columns},
         {part.x + rows, part.y, part.rows - rows, columns},
         {part.x + rows, part.y + columns, part.rows - rows, part.columns - columns}}};
    const bool all = std::all_of(quarters.begin(), quarters.end(),
                                 [&](const CellWindow& q) { return mosaic.touches(q, cell); });
    if (!all) {
      for (const CellWindow& quarter : quarters) fillTerrain(mosaic, cell, radius, use, whole, quarter, out);
      return;
    }
  }
  const CellWindow wide{part.x - radius, part.y - radius, part.rows + 2 * radius, part.columns + 2 * radius};
  const std::vector<float> elevation = mosaic.surface(wide).elevation;
  const std::vector<float> values = use(TerrainView{elevation.data(), part.rows, part.columns, radius, cell});
  for (std::int32_t row = 0; row < part.rows; ++row)
    std::copy_n(&values[part.at(row, 0)], part.columns,
                out + whole.at(part.x - whole.x + row, part.y - whole.y));
}

template <typename Use>
RasterSource terrainSource(const std::shared_ptr<PatchMosaic>& mosaic, double cell, int radius, float step,
                           Use use) {
  RasterSource source;
  source.extent = mosaic->surfaceExtent();
  source.cell = cell;
  source.touches = [mosaic, cell](const CellWindow& w) { return mosaic->touches(w, cell); };
  source.fill = [mosaic, cell, radius, step, use](const CellWindow& w, void* out) {
    auto* values = static_cast<float*>(out);
    std::fill_n(values, w.cells(), std::numeric_limits<float>::quiet_NaN());
    fillTerrain(*mosaic, cell, radius, use, w, w, values);
    for (std::size_t k = 0; k < w.cells(); ++k) values[k] = rounded(values[k], step);
  };
  return source;
}

template <typename Pick>
RasterSource surfaceSource(const std::shared_ptr<PatchMosaic>& mosaic, double cell, float step, Pick pick) {
  RasterSource source;
  source.extent = mosaic->surfaceExtent();
  source.cell = cell;
  source.touches = [mosaic, cell](const CellWindow& w) { return mosaic->touches(w, cell); };
  source.fill = [mosaic, step, pick](const CellWindow& w, void* out) {
    const PatchMosaic::Surface surface = mosaic->surface(w);
    const std::vector<float>& values = pick(surface);
    std::transform(values.begin(), values.end(), static_cast<float*>(out),
                   [step](float v) { return rounded(v, step); });
  };
  return source;
}

RasterSource mosaicSource(const std::shared_ptr<PatchMosaic>& mosaic, double cell) {
  RasterSource source;
  source.colour = true;
  source.cell = cell;
  source.extent = mosaic->mosaicExtent();
  source.touches = [mosaic, cell](const CellWindow& w) { return mosaic->touches(w, cell); };
  source.fill = [mosaic](const CellWindow& w, void* out) {
    mosaic->colours(w, static_cast<std::uint8_t*>(out));
  };
  return source;
}

void addTileLayers(const LayerInputs& inputs, const LayerConfig& config, std::vector<Layer>& layers) {
  if (inputs.tiles.empty()) return;
  const double cell = config.cells.surface;
  // One each: layers are made at the same time.
  const auto mosaic = [&] {
    return std::make_shared<PatchMosaic>(inputs.grid, config.cells, inputs.tiles, inputs.patch);
  };
  using Surface = PatchMosaic::Surface;
  const TerrainWindow slope{radiusOf(config.slope_window, cell), config.min_coverage};
  const TerrainWindow rough{radiusOf(config.rugosity_window, cell), config.min_coverage};

  Layer elevation{{"elevation", "Elevation", "m", "", 0, 0, "viridis", ""}, {}};
  elevation.source = surfaceSource(mosaic(), cell, kHeightStep,
                                   [](const Surface& s) -> const std::vector<float>& { return s.elevation; });
  elevation.shaded = true;
  layers.push_back(elevation);

  Layer colours{{"orthomosaic", "Orthomosaic", "", "", 0, 0, "", ""},
                mosaicSource(mosaic(), config.cells.mosaic)};
  layers.push_back(colours);

  Layer steep{{"slope", "Slope", "deg", "", 0, 0, "magma", ""}, {}};
  steep.source = terrainSource(mosaic(), cell, slope.radius, kDegreeStep,
                               [slope](const TerrainView& view) { return slopeAspect(view, slope).slope; });
  steep.from_zero = true;
  layers.push_back(steep);

  Layer aspect{
      {"aspect", "Aspect (the direction in which the ground falls)", "deg", "", 0, 0, "twilight", ""}, {}};
  aspect.source = terrainSource(mosaic(), cell, slope.radius, kDegreeStep,
                                [slope](const TerrainView& view) { return slopeAspect(view, slope).aspect; });
  aspect.average = false;
  aspect.from_zero = true;
  aspect.fixed_max = 360;
  layers.push_back(aspect);

  Layer rugged{{"rugosity", "Rugosity (surface over plane of best fit)", "", "", 0, 0, "magma", ""}, {}};
  rugged.source = terrainSource(mosaic(), cell, rough.radius, kRugosityStep,
                                [rough](const TerrainView& view) { return rugosity(view, rough); });
  layers.push_back(rugged);

  Layer views{{"views", "Stereo pairs that saw the surface", "", "", 0, 0, "viridis", ""}, {}};
  views.source = surfaceSource(mosaic(), cell, kWholeStep,
                               [](const Surface& s) -> const std::vector<float>& { return s.views; });
  views.average = false;
  views.from_zero = true;
  layers.push_back(views);

  Layer sigma{{"uncertainty", "Height uncertainty (1 sigma)", "m", "", 0, 0, "turbo", ""}, {}};
  sigma.source = surfaceSource(mosaic(), cell, kHeightStep,
                               [](const Surface& s) -> const std::vector<float>& { return s.sigma; });
  sigma.from_zero = true;
  layers.push_back(sigma);
}

void addStatistics(const fusion::CellStatistics& statistics, std::vector<Layer>& layers) {
  const auto meshes = std::make_shared<SparseCells>(statistics.cell()),
             deviation = std::make_shared<SparseCells>(statistics.cell());
  for (const auto& cell : statistics.cells()) {
    meshes->set(cell.x, cell.y, static_cast<float>(cell.meshes));
    if (cell.meshes > 1) deviation->set(cell.x, cell.y, static_cast<float>(cell.deviation));
  }
  Layer count{{"meshes", "Stereo meshes before fusion", "", "", 0, 0, "viridis", ""}, sourceOf(meshes)};
  count.average = false;
  count.from_zero = true;
  layers.push_back(count);
  Layer spread{{"deviation", "Deviation of depth between meshes before fusion", "m", "", 0, 0, "turbo", ""},
               sourceOf(deviation)};
  spread.from_zero = true;
  layers.push_back(spread);
}

void addTrack(const std::vector<DiveTrackPoint>& track, const LayerConfig& config,
              std::vector<Layer>& layers) {
  for (TrackLayer& made : trackLayers(track, config.track_cell, config.track_radius))
    layers.push_back({{made.name, made.title, made.unit, "", 0, 0, "turbo", ""}, sourceOf(made.cells)});
}

// Writes one layer; none when it holds no value.
std::optional<LayerInfo> writeLayer(const std::filesystem::path& out, const std::optional<Geodetic>& origin,
                                    const LayerConfig& config, const Layer& layer) {
  const std::filesystem::path folder = "layers";
  LayerInfo info = layer.info;
  info.file = (folder / (info.name + ".tif")).string();
  writeCog(out / info.file, layer.source,
           {origin, info.title, info.unit, layer.average, config.mosaic_quality});
  const ReducedRaster raster =
      readReduced(out / info.file, config.picture_pixels > 0 ? config.picture_pixels : kLegendPixels);
  const bool any = layer.source.colour
                       ? std::any_of(raster.rgba.begin(), raster.rgba.end(), [](auto v) { return v != 0; })
                       : legend(raster, layer, info);
  if (!any) {
    std::filesystem::remove(out / info.file);
    return std::nullopt;
  }
  if (config.picture_pixels > 0) {
    info.picture = (folder / (info.name + ".png")).string();
    drawLayer(out / info.picture, raster, {info.title, info.unit, info.min, info.max, info.ramp},
              layer.shaded);
  }
  return info;
}

}  // namespace

std::vector<LayerInfo> writeLayers(const std::filesystem::path& out, const LayerInputs& inputs,
                                   const LayerConfig& config) {
  std::vector<Layer> layers;
  addTileLayers(inputs, config, layers);
  if (inputs.statistics != nullptr) addStatistics(*inputs.statistics, layers);
  if (inputs.track != nullptr) addTrack(*inputs.track, config, layers);
  std::erase_if(layers, [](const Layer& layer) { return layer.source.extent.cells() == 0; });
  std::filesystem::create_directories(out / "layers");

  std::vector<std::optional<LayerInfo>> made(layers.size());
  oneapi::tbb::parallel_for(
      std::size_t{0}, layers.size(), std::size_t{1},
      [&](std::size_t k) {
        made[k] = writeLayer(out, inputs.origin, config, layers[k]);
        layers[k].source = {};  // its patches are not needed any longer
      },
      oneapi::tbb::simple_partitioner());
  std::vector<LayerInfo> written;
  for (auto& info : made)
    if (info) written.push_back(std::move(*info));
  return written;
}

}  // namespace fathom::topside
