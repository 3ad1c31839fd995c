#include "recon/topside/input/region.hpp"

#include <cpl_error.h>
#include <gdal_priv.h>
#include <ogrsf_frmts.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {
namespace {

double areaOf(const std::vector<Eigen::Vector2d>& ring) {
  double twice = 0;
  for (std::size_t k = 0; k < ring.size(); ++k) {
    const Eigen::Vector2d &a = ring[k], &b = ring[(k + 1) % ring.size()];
    twice += a.x() * b.y() - b.x() * a.y();
  }
  return 0.5 * std::abs(twice);
}

// Whether a ray towards greater east crosses the ring an odd number of times.
bool insideOf(const std::vector<Eigen::Vector2d>& ring, const Eigen::Vector2d& p) {
  bool inside = false;
  for (std::size_t k = 0, before = ring.size() - 1; k < ring.size(); before = k++) {
    const Eigen::Vector2d &a = ring[before], &b = ring[k];
    if ((a.x() > p.x()) == (b.x() > p.x())) continue;
    inside ^= p.y() < a.y() + (p.x() - a.x()) / (b.x() - a.x()) * (b.y() - a.y());
  }
  return inside;
}

template <typename T>
void keepOf(std::vector<T>& values, const std::vector<std::uint32_t>& kept) {
  if (values.empty()) return;
  std::vector<T> out;
  for (const std::uint32_t k : kept) out.push_back(values[k]);
  values = std::move(out);
}

}  // namespace

Region::Region(const std::filesystem::path& file, const std::optional<Geodetic>& origin) {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  GDALAllRegister();
  const GDALDatasetUniquePtr set(
      GDALDataset::Open(file.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!set)
    throw InputError(
        file.string(), "",
        "cannot be read as GeoJSON or another vector file: " + std::string(CPLGetLastErrorMsg()));
  std::optional<LocalTransverseMercator> projection;
  if (origin) projection.emplace(*origin);
  OGRSpatialReference degrees;
  constexpr int kWgs84 = 4326;
  (void)degrees.importFromEPSG(kWgs84);
  degrees.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const auto takeRing = [&](const OGRLinearRing& from, Polygon& polygon) {
    Ring ring;
    for (const OGRPoint& point : from) {
      constexpr double kPole = 90, kRound = 360;
      Eigen::Vector2d place(point.getY(), point.getX());
      if (projection && std::abs(place.x()) <= kPole && std::abs(place.y()) <= kRound)
        place = projection->toLocal({place.x() * kRadiansPerDegree, place.y() * kRadiansPerDegree});
      else if (projection || !place.allFinite())
        throw InputError(file.string(), formatted("%g, %g", place.x(), place.y()),
                         "is no place on Earth; GeoJSON has longitudes, then latitudes");
      ring.push_back(place);
    }
    if (ring.size() > 1 && ring.front() == ring.back()) ring.pop_back();
    if (ring.size() > 2) polygon.rings.push_back(std::move(ring));
  };
  const auto takePolygon = [&](const OGRPolygon& from) {
    Polygon polygon;
    if (from.getExteriorRing() != nullptr) takeRing(*from.getExteriorRing(), polygon);
    if (polygon.rings.empty()) return;
    for (int k = 0; k < from.getNumInteriorRings(); ++k) takeRing(*from.getInteriorRing(k), polygon);
    for (const Eigen::Vector2d& p : polygon.rings.front()) polygon.box.extend(p);
    polygons_.push_back(std::move(polygon));
  };
  for (OGRLayer* layer : set->GetLayers()) {
    std::unique_ptr<OGRCoordinateTransformation> transform;
    if (projection) {
      if (layer->GetSpatialRef() == nullptr)
        throw InputError(file.string(), layer->GetName(),
                         "does not say its coordinate reference system, which a dive on Earth needs");
      OGRSpatialReference from = *layer->GetSpatialRef();
      from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
      transform.reset(OGRCreateCoordinateTransformation(&from, &degrees));
      if (!transform)
        throw InputError(file.string(), layer->GetName(), "cannot be turned into latitudes and longitudes");
    }
    for (const auto& feature : *layer) {
      OGRGeometry* shape = feature->GetGeometryRef();
      if (shape == nullptr) continue;
      if (transform && shape->transform(transform.get()) != OGRERR_NONE)
        throw InputError(file.string(), layer->GetName(), "cannot be turned into latitudes and longitudes");
      const auto kind = wkbFlatten(shape->getGeometryType());
      if (kind == wkbPolygon) takePolygon(*shape->toPolygon());
      if (kind == wkbMultiPolygon)
        for (const OGRPolygon* part : *shape->toMultiPolygon()) takePolygon(*part);
    }
  }
  if (polygons_.empty())
    throw InputError(file.string(), "", "has no polygon; measure an area in the viewer and save it");
  Hasher hasher;
  for (const Polygon& polygon : polygons_)
    for (const Ring& ring : polygon.rings) {
      hasher.add(static_cast<std::uint64_t>(ring.size()));
      for (const Eigen::Vector2d& p : ring) hasher.add(p.x(), p.y());
    }
  identity_ = hasher.finish();
}

bool Region::contains(double north, double east) const {
  const Eigen::Vector2d p(north, east);
  for (const Polygon& polygon : polygons_) {
    if (!polygon.box.contains(p)) continue;
    bool inside = false;  // of the outer ring, and of no hole
    for (const Ring& ring : polygon.rings) inside ^= insideOf(ring, p);
    if (inside) return true;
  }
  return false;
}

bool Region::mayMeet(const Eigen::AlignedBox2d& box) const {
  return std::any_of(polygons_.begin(), polygons_.end(),
                     [&](const Polygon& polygon) { return polygon.box.intersects(box); });
}

double Region::area() const {
  double sum = 0;
  for (const Polygon& polygon : polygons_)
    for (const Ring& ring : polygon.rings) sum += (&ring == polygon.rings.data() ? 1 : -1) * areaOf(ring);
  return sum;
}

Eigen::AlignedBox2d Region::box() const {
  Eigen::AlignedBox2d all;
  for (const Polygon& polygon : polygons_) all.extend(polygon.box);
  return all;
}

TileMesh Region::inside(const TileMesh& tile) const {
  TileMesh out = tile;
  Mesh& mesh = out.mesh;
  std::erase_if(mesh.triangles, [&](const auto& t) {
    const Eigen::Vector3f middle = (mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3.0F;
    return !contains(static_cast<double>(middle.x()), static_cast<double>(middle.y()));
  });
  constexpr std::uint32_t kUnused = 0xFFFFFFFF;
  std::vector<std::uint32_t> number(mesh.vertices.size(), kUnused), kept;
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& corner : triangle) {
      if (number[corner] == kUnused) {
        number[corner] = static_cast<std::uint32_t>(kept.size());
        kept.push_back(corner);
      }
      corner = number[corner];
    }
  keepOf(mesh.vertices, kept);
  keepOf(mesh.normals, kept);
  keepOf(mesh.colours, kept);
  keepOf(mesh.texture_coordinates, kept);
  keepOf(mesh.sigma, kept);
  keepOf(out.shared, kept);
  keepOf(out.views, kept);
  return out;
}

}  // namespace fathom::topside
