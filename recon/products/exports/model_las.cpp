#include "recon/products/exports/model_glb.hpp"

#include <ogr_spatialref.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/tiles/model_file.hpp"

namespace fathom::topside {
namespace {

static_assert(std::endian::native == std::endian::little, "LAS is written as it is in memory");

constexpr double kScale = 0.001;  // [m]
constexpr std::uint16_t kHeaderBytes = 375, kRecordHeaderBytes = 54, kPointBytes = 36;
constexpr std::uint8_t kPointFormat = 7;
constexpr std::uint16_t kWktFollows = 0x10, kWktRecord = 2112;  // of the header's flags; the record's number

class Bytes {
 public:
  template <typename Number>
  Bytes& put(Number value) {
    const std::size_t at = text.size();
    text.resize(at + sizeof value);
    std::memcpy(&text[at], &value, sizeof value);
    return *this;
  }
  Bytes& words(std::string value, std::size_t length) {  // padded with zeros
    value.resize(length);
    text += value;
    return *this;
  }
  std::string text;
};

// Version 1 of WKT, which LAS asks for, with the zero that ends it.
std::string wktOf(const std::string& crs) {
  if (crs.empty())
    return std::string(
               R"(LOCAL_CS["the dive's own",UNIT["metre",1],AXIS["East",EAST],AXIS["North",NORTH]])") +
           '\0';
  OGRSpatialReference srs;
  char* text = nullptr;
  std::string wkt;
  if (srs.SetFromUserInput(crs.c_str()) == OGRERR_NONE && srs.exportToWkt(&text) == OGRERR_NONE) wkt = text;
  CPLFree(text);
  return wkt + '\0';
}

struct Extent {
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
};

std::string headOf(const std::string& wkt, const Extent& extent, std::uint64_t points) {
  Bytes head;
  head.words("LASF", 4).put(std::uint16_t{0}).put(kWktFollows).words("", 16);
  head.put(std::uint8_t{1}).put(std::uint8_t{4}).words("", 32).words("Fathom", 32);
  head.put(std::uint16_t{0}).put(std::uint16_t{0}).put(kHeaderBytes);  // day and year stay empty
  head.put(static_cast<std::uint32_t>(kHeaderBytes + kRecordHeaderBytes + wkt.size())).put(std::uint32_t{1});
  head.put(kPointFormat).put(kPointBytes).words("", 4 + 5 * 4);  // counts of older versions
  for (int axis = 0; axis < 3; ++axis) head.put(kScale);
  for (const double offset : extent.offset) head.put(offset);
  for (int axis = 0; axis < 3; ++axis) head.put(extent.high[axis]).put(extent.low[axis]);
  head.words("", 8 + 8 + 4).put(points).put(points).words("", 14 * 8);  // all are first returns
  head.words("", 2).words("LASF_Projection", 16).put(kWktRecord);
  head.put(static_cast<std::uint16_t>(wkt.size())).words("WKT", 32);
  return head.text + wkt;
}

}  // namespace

ModelCounts writeModelLas(const std::filesystem::path& path, std::vector<TileId> tiles,
                          const TileSource& source, const compare::PlaneFrame& own, const std::string& crs) {
  const compare::PlaneFrame frame = frameNamed(crs);
  if (compare::isGeographic(frame))
    throw InputError("--crs", crs, "is in degrees, and LAS asks for metres; give a projected system");
  const compare::PlaneTransform transform(own, frame);
  const std::string wkt = wktOf(crs);
  std::sort(tiles.begin(), tiles.end());
  AtomicFile file(path);
  file.stream() << headOf(wkt, {}, 0);
  JoinedVertices joined;
  Extent extent;
  for (const TileId& id : tiles) {
    const ReadTile read = source(id);
    const JoinedVertices::Numbers numbers = joined.add(read.tile.surface);
    std::vector<double> x, y;
    for (const std::uint32_t k : numbers.added) {
      const Eigen::Vector3f& v = read.tile.surface.mesh.vertices[k];
      x.push_back(static_cast<double>(v.y()));
      y.push_back(static_cast<double>(v.x()));
    }
    transform.apply(x, y);
    Bytes points;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const std::uint32_t k = numbers.added[i];
      const Eigen::Vector3d place(x[i], y[i], -static_cast<double>(read.tile.surface.mesh.vertices[k].z()));
      if (!place.allFinite()) throw InputError("--crs", crs, "does not reach where the dive was");
      if (extent.low.x() > extent.high.x()) extent.offset << place.head<2>().array().round(), 0;
      const Eigen::Vector3d steps = ((place - extent.offset) / kScale).array().round();
      extent.low = extent.low.cwiseMin(extent.offset + kScale * steps);
      extent.high = extent.high.cwiseMax(extent.offset + kScale * steps);
      for (const double step : steps) points.put(static_cast<std::int32_t>(step));
      points.put(std::uint16_t{0}).put(std::uint8_t{0x11}).put(std::uint8_t{0});  // return 1 of 1
      points.put(std::uint8_t{1}).words("", 1 + 2 + 2 + 8);
      constexpr std::uint16_t kTo16 = 257;  // of 8 bits
      for (const std::uint8_t channel : vertexColour(read.tile, k))
        points.put(static_cast<std::uint16_t>(kTo16 * channel));
    }
    file.stream() << points.text;
  }
  file.stream().seekp(0);
  file.stream() << headOf(wkt, extent, joined.count());
  file.commit();
  return {tiles.size(), joined.count(), 0};
}

}  // namespace fathom::topside
