#include "recon/products/rasters/terrain.hpp"

#include <gdal_priv.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <stdexcept>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {
namespace {

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
  const GDALDatasetUniquePtr file(static_cast<GDALDataset*>(GDALOpen(path.c_str(), GA_ReadOnly)));
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

namespace {

constexpr double kLevel = 1e-5;  // gradient below which a plane has no aspect

// Sums over rectangles of the view from its corner.
template <std::size_t N>
class Integral {
 public:
  using Terms = std::array<double, N>;
  Integral(std::int32_t rows, std::int32_t columns)
      : columns_(columns + 1),
        sums_(static_cast<std::size_t>(rows + 1) * static_cast<std::size_t>(columns + 1)) {}
  // Row by row, column by column.
  void set(std::int32_t row, std::int32_t column, const Terms& terms) {
    const Terms &left = at(row + 1, column), &above = at(row, column + 1), &corner = at(row, column);
    Terms& here = at(row + 1, column + 1);
    for (std::size_t k = 0; k < N; ++k) here[k] = terms[k] + left[k] + above[k] - corner[k];
  }
  // Rows [r0, r1), columns [c0, c1).
  [[nodiscard]] Terms sum(std::int32_t r0, std::int32_t c0, std::int32_t r1, std::int32_t c1) const {
    Terms out;
    const Terms &a = at(r0, c0), &b = at(r0, c1), &c = at(r1, c0), &d = at(r1, c1);
    for (std::size_t k = 0; k < N; ++k) out[k] = d[k] - b[k] - c[k] + a[k];
    return out;
  }

 private:
  [[nodiscard]] std::size_t index(std::int32_t row, std::int32_t column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }
  Terms& at(std::int32_t row, std::int32_t column) { return sums_[index(row, column)]; }
  const Terms& at(std::int32_t row, std::int32_t column) const { return sums_[index(row, column)]; }

  std::int32_t columns_;
  std::vector<Terms> sums_;
};

// 1, n, e, nn, ne, ee, z, nz, ez of known cells; n and e in cells of the view.
using PlaneSums = Integral<9>;

struct Whole {
  std::int32_t rows, columns;
  explicit Whole(const TerrainView& view)
      : rows(view.rows + 2 * view.halo), columns(view.columns + 2 * view.halo) {}
  [[nodiscard]] std::size_t at(std::int32_t row, std::int32_t column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
};

PlaneSums planeSums(const TerrainView& view) {
  const Whole whole(view);
  double mean = 0, known = 0;  // sums of small numbers lose less
  for (std::size_t k = 0; k < whole.at(whole.rows, 0); ++k)
    if (std::isfinite(view.elevation[k])) mean += static_cast<double>(view.elevation[k]), ++known;
  mean = known > 0 ? mean / known : 0;
  PlaneSums sums(whole.rows, whole.columns);
  const std::int32_t middle_row = whole.rows / 2, middle_column = whole.columns / 2;
  for (std::int32_t n = 0; n < whole.rows; ++n) {
    for (std::int32_t e = 0; e < whole.columns; ++e) {
      const double z = static_cast<double>(view.elevation[whole.at(n, e)]) - mean;
      const double dn = n - middle_row, de = e - middle_column;
      sums.set(n, e,
               std::isfinite(z) ? PlaneSums::Terms{1, dn, de, dn * dn, dn * de, de * de, z, dn * z, de * z}
                                : PlaneSums::Terms{});
    }
  }
  return sums;
}

struct Gradient {
  double north = 0, east = 0;
  bool known = false;
};

Gradient fit(const PlaneSums::Terms& s, double cells, const TerrainWindow& window, double cell) {
  const double n = std::round(s[0]);
  if (n < 3 || n < window.min_coverage * cells) return {};
  const double nn = s[3] - s[1] * s[1] / n, ne = s[4] - s[1] * s[2] / n, ee = s[5] - s[2] * s[2] / n;
  const double nz = s[7] - s[1] * s[6] / n, ez = s[8] - s[2] * s[6] / n;
  const double det = nn * ee - ne * ne;
  if (!(det > 1e-3 * nn * ee)) return {};  // known cells in one line
  return {(nz * ee - ez * ne) / det / cell, (ez * nn - nz * ne) / det / cell, true};
}

// In a window of (2 radius + 1)^2 cells about one.
Gradient gradientAbout(const PlaneSums& sums, std::int32_t row, std::int32_t column,
                       const TerrainWindow& window, double cell) {
  const int r = window.radius, side = 2 * r + 1;
  return fit(sums.sum(row - r, column - r, row + r + 1, column + r + 1), static_cast<double>(side) * side,
             window, cell);
}

}  // namespace

int radiusOf(double edge, double cell) {
  return std::max(1, static_cast<int>(std::ceil((edge / cell - 1) / 2 - 1e-9)));
}

SlopeAspect slopeAspect(const TerrainView& view, const TerrainWindow& window) {
  const PlaneSums sums = planeSums(view);
  const Whole whole(view);
  SlopeAspect out;
  const std::size_t cells = static_cast<std::size_t>(view.rows) * static_cast<std::size_t>(view.columns);
  out.slope.assign(cells, kNoValue);
  out.aspect.assign(cells, kNoValue);
  for (std::int32_t n = 0, k = 0; n < view.rows; ++n) {
    for (std::int32_t e = 0; e < view.columns; ++e, ++k) {
      const std::int32_t row = n + view.halo, column = e + view.halo;
      if (std::isnan(view.elevation[whole.at(row, column)])) continue;
      const Gradient g = gradientAbout(sums, row, column, window, view.cell);
      if (!g.known) continue;
      const auto at = static_cast<std::size_t>(k);
      const double steep = hypotenuse(g.north, g.east);
      out.slope[at] = static_cast<float>(std::atan(steep) * kDegreesPerRadian);
      if (steep < kLevel) continue;
      const double aspect = std::atan2(-g.east, -g.north) * kDegreesPerRadian;
      const auto turned = static_cast<float>(aspect < 0 ? aspect + 360 : aspect);
      out.aspect[at] = turned < 360 ? turned : 0;
    }
  }
  return out;
}

std::vector<float> rugosity(const TerrainView& view, const TerrainWindow& window) {
  const PlaneSums sums = planeSums(view);
  const Whole whole(view);
  const double c2 = view.cell * view.cell;
  // Quads between four cells' middles: how many are known, and their area.
  Integral<2> quads(whole.rows - 1, whole.columns - 1);
  for (std::int32_t n = 0; n + 1 < whole.rows; ++n) {
    for (std::int32_t e = 0; e + 1 < whole.columns; ++e) {
      const double a = static_cast<double>(view.elevation[whole.at(n, e)]),
                   b = static_cast<double>(view.elevation[whole.at(n, e + 1)]),
                   c = static_cast<double>(view.elevation[whole.at(n + 1, e)]),
                   d = static_cast<double>(view.elevation[whole.at(n + 1, e + 1)]);
      const auto area = [&](double dx, double dy) { return 0.5 * std::sqrt(c2 * (c2 + dx * dx + dy * dy)); };
      const double both =
          0.5 * (area(c - a, b - a) + area(d - b, d - c) + area(c - a, d - c) + area(d - b, b - a));
      quads.set(n, e, std::isfinite(both) ? std::array<double, 2>{1, both} : std::array<double, 2>{});
    }
  }
  const int r = window.radius;
  std::vector<float> out(static_cast<std::size_t>(view.rows) * static_cast<std::size_t>(view.columns),
                         kNoValue);
  for (std::int32_t n = 0, k = 0; n < view.rows; ++n) {
    for (std::int32_t e = 0; e < view.columns; ++e, ++k) {
      const std::int32_t row = n + view.halo, column = e + view.halo;
      if (std::isnan(view.elevation[whole.at(row, column)])) continue;
      const Gradient g = gradientAbout(sums, row, column, window, view.cell);
      const auto [count, area] = quads.sum(row - r, column - r, row + r, column + r);
      if (!g.known || std::round(count) < 1) continue;
      const double projected = std::round(count) * c2 * std::sqrt(1 + g.north * g.north + g.east * g.east);
      out[static_cast<std::size_t>(k)] = static_cast<float>(area / projected);
    }
  }
  return out;
}

}  // namespace fathom::topside
