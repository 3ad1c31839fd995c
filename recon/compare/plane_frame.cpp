#include "recon/compare/plane_frame.hpp"

#include <ogr_spatialref.h>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::compare {
namespace {

struct FreeTransform {
  void operator()(OGRCoordinateTransformation* t) const { OGRCoordinateTransformation::DestroyCT(t); }
};

// With x before y, as files of points and rasters have them.
OGRSpatialReference referenceOf(const PlaneFrame& frame) {
  OGRSpatialReference srs;
  srs.importFromWkt(frame.wkt.c_str());
  srs.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  return srs;
}

std::string wktOf(const OGRSpatialReference& srs) {
  char* text = nullptr;
  const char* const options[] = {"FORMAT=WKT2_2018", nullptr};
  std::string wkt;
  if (srs.exportToWkt(&text, options) == OGRERR_NONE && text != nullptr) wkt = text;
  CPLFree(text);
  return wkt;
}

}  // namespace

PlaneFrame localFrame(const Geodetic& origin) {
  return frameFrom(formatted("+proj=tmerc +lat_0=%.15g +lon_0=%.15g +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m",
                             origin.latitude * kDegreesPerRadian, origin.longitude * kDegreesPerRadian),
                   "origin");
}

PlaneFrame frameFrom(const std::string& definition, const std::string& where) {
  OGRSpatialReference srs;
  CPLPushErrorHandler(CPLQuietErrorHandler);
  const OGRErr error = srs.SetFromUserInput(definition.c_str());
  CPLPopErrorHandler();
  if (error != OGRERR_NONE || !(srs.IsProjected() || srs.IsGeographic()))
    throw InputError(where, definition.substr(0, 60),
                     "is no coordinate reference system; give EPSG:<code>, WKT or a PROJ string");
  if (srs.IsProjected() && std::abs(srs.GetLinearUnits() - 1.0) > 1e-9)
    throw InputError(where, definition.substr(0, 60), "is not in metres; give one that is");
  return {wktOf(srs)};
}

bool isGeographic(const PlaneFrame& frame) {
  return frame.known() && referenceOf(frame).IsGeographic();
}

struct PlaneTransform::Impl {
  OGRSpatialReference from, to;
  std::unique_ptr<OGRCoordinateTransformation, FreeTransform> transform;
};

PlaneTransform::PlaneTransform(const PlaneFrame& from, const PlaneFrame& to) {
  if (!from.known() || !to.known() || from.wkt == to.wkt) return;
  impl_ = std::make_unique<Impl>();
  impl_->from = referenceOf(from);
  impl_->to = referenceOf(to);
  if (impl_->from.IsSame(&impl_->to)) {
    impl_.reset();
    return;
  }
  CPLPushErrorHandler(CPLQuietErrorHandler);
  impl_->transform.reset(OGRCreateCoordinateTransformation(&impl_->from, &impl_->to));
  CPLPopErrorHandler();
  if (!impl_->transform)
    throw InputError("coordinate reference system", "", "cannot be transformed into the survey's frame");
}

PlaneTransform::~PlaneTransform() = default;

void PlaneTransform::apply(std::vector<double>& x, std::vector<double>& y) const {
  if (!impl_ || x.empty()) return;
  std::vector<int> good(x.size(), 0);
  CPLPushErrorHandler(CPLQuietErrorHandler);
  impl_->transform->Transform(static_cast<int>(x.size()), x.data(), y.data(), nullptr, good.data());
  CPLPopErrorHandler();
  for (std::size_t i = 0; i < x.size(); ++i)
    if (good[i] == 0) x[i] = y[i] = std::numeric_limits<double>::quiet_NaN();
}

Box PlaneTransform::apply(const Box& box) const {
  if (!impl_) return box;
  constexpr int kSteps = 20;  // along a side: a side is a curve in the other frame
  std::vector<double> x, y;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      x.push_back(box.west + (box.east - box.west) * i / kSteps);
      y.push_back(box.south + (box.north - box.south) * j / kSteps);
    }
  }
  apply(x, y);
  Box out{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
          -std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!std::isfinite(x[i])) continue;
    out = {std::min(out.west, x[i]), std::min(out.south, y[i]), std::max(out.east, x[i]),
           std::max(out.north, y[i])};
  }
  return out;
}

HeightMap::HeightMap(const Box& box, double cell_m) : cell(cell_m) {
  const double first = std::floor(box.west / cell), top = std::ceil(box.north / cell);
  west = first * cell;
  north = top * cell;
  columns = static_cast<int>(std::ceil(box.east / cell) - first);
  rows = static_cast<int>(top - std::floor(box.south / cell));
  up.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows),
            std::numeric_limits<float>::quiet_NaN());
}

std::size_t HeightMap::known() const {
  return static_cast<std::size_t>(
      std::count_if(up.begin(), up.end(), [](float h) { return std::isfinite(h); }));
}

double HeightMap::at(double east, double north_m) const {
  const double x = (east - west) / cell - 0.5, y = (north - north_m) / cell - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  if (!(x0 >= 0 && y0 >= 0 && x0 + 1 < columns && y0 + 1 < rows))
    return std::numeric_limits<double>::quiet_NaN();
  const std::size_t at = index(static_cast<int>(x0), static_cast<int>(y0));
  const auto value = [&](std::size_t i) { return static_cast<double>(up[i]); };
  const double fx = x - x0, fy = y - y0;
  const std::size_t below = at + static_cast<std::size_t>(columns);
  return (1 - fy) * ((1 - fx) * value(at) + fx * value(at + 1)) +
         fy * ((1 - fx) * value(below) + fx * value(below + 1));
}

HeightMap HeightMap::coarser(int factor) const {
  if (factor <= 1) return *this;
  HeightMap out;
  out.west = west;
  out.north = north;
  out.cell = cell * factor;
  out.columns = (columns + factor - 1) / factor;
  out.rows = (rows + factor - 1) / factor;
  const std::size_t size = static_cast<std::size_t>(out.columns) * static_cast<std::size_t>(out.rows);
  out.up.assign(size, std::numeric_limits<float>::quiet_NaN());
  if (!sigma.empty()) out.sigma.assign(size, std::numeric_limits<float>::quiet_NaN());
  for (int row = 0; row < out.rows; ++row) {
    for (int column = 0; column < out.columns; ++column) {
      double sum = 0, sigma_sum = 0;
      int count = 0;
      for (int y = row * factor; y < std::min(rows, (row + 1) * factor); ++y) {
        for (int x = column * factor; x < std::min(columns, (column + 1) * factor); ++x) {
          const std::size_t i = index(x, y);
          if (!std::isfinite(up[i])) continue;
          sum += static_cast<double>(up[i]);
          if (!sigma.empty()) sigma_sum += static_cast<double>(sigma[i]);
          ++count;
        }
      }
      if (2 * count < factor * factor) continue;
      out.up[out.index(column, row)] = static_cast<float>(sum / count);
      if (!sigma.empty()) out.sigma[out.index(column, row)] = static_cast<float>(sigma_sum / count);
    }
  }
  return out;
}

double medianHeight(const HeightMap& map) {
  std::vector<double> known;
  for (const float h : map.up)
    if (std::isfinite(h)) known.push_back(static_cast<double>(h));
  return median(std::move(known), std::numeric_limits<double>::quiet_NaN());
}

}  // namespace fathom::compare
