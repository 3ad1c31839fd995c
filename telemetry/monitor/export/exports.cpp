#include "telemetry/monitor/export/exports.hpp"

#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>
#include <sstream>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply_writer.hpp"
#include "telemetry/monitor/export/geo_raster.hpp"

namespace fathom::monitor {

using nlohmann::ordered_json;

namespace {

constexpr const char* kNoOrigin =
    "the mission's origin has not arrived yet, so nothing can be placed on the Earth";

std::string plyOf(ModelView& view) {
  std::vector<std::string> comments{"nav frame: x north, y east, z down [m]",
                                    "as received over the acoustic link"};
  if (const auto& mission = view.mission()) {
    std::ostringstream origin;
    origin.precision(10);
    origin << "origin " << mission->origin.latitude / kRadiansPerDegree << ' '
           << mission->origin.longitude / kRadiansPerDegree << " deg WGS84, local transverse Mercator";
    comments.push_back(origin.str());
  }
  std::ostringstream out;
  writePly(out, view.surface().whole(), comments);
  return std::move(out).str();
}

}  // namespace

std::string trackGeoJson(const ModelView& view) {
  if (!view.mission() || view.track().empty()) return {};
  const LocalTransverseMercator projection(view.mission()->origin);
  const auto position = [&](const TrackRecord& p) {
    const Geodetic g = projection.toGeodetic({p.north, p.east});
    return ordered_json{g.longitude / kRadiansPerDegree, g.latitude / kRadiansPerDegree, -p.depth};
  };
  ordered_json line = ordered_json::array(), times = ordered_json::array();
  for (const auto& [utc_ns, p] : view.track()) {
    line.push_back(position(p));
    times.push_back(static_cast<double>(utc_ns) * 1e-9);
  }
  ordered_json features = ordered_json::array();
  const auto identity = view.identity();
  const ordered_json last_position = line.back();
  // GeoJSON wants at least two positions in a line.
  if (line.size() > 1)
    features.push_back({{"type", "Feature"},
                        {"properties", {{"name", "track"}, {"utc_s", times}}},
                        {"geometry", {{"type", "LineString"}, {"coordinates", line}}}});
  features.push_back({{"type", "Feature"},
                      {"properties",
                       {{"name", view.mission()->vehicle_name},
                        {"vehicle_id", identity.vehicle_id},
                        {"dive_id", identity.dive_id},
                        {"utc_s", times.back()}}},
                      {"geometry", {{"type", "Point"}, {"coordinates", last_position}}}});
  return ordered_json{{"type", "FeatureCollection"}, {"features", features}}.dump(1) + "\n";
}

Export makeExport(ModelView& view, std::string_view name) {
  Export out;
  if (name == "track.geojson") {
    out.type = "application/geo+json";
    out.bytes = trackGeoJson(view);
    if (out.bytes.empty()) out.why = view.mission() ? "no position has arrived yet" : kNoOrigin;
    return out;
  }
  if (view.store().size() == 0) {
    out.why = "no map has arrived yet";
    return out;
  }
  if (name == "map.ply") {
    out.bytes = plyOf(view);
    return out;
  }
  if (!view.mission()) {
    out.why = kNoOrigin;
    return out;
  }
  out.type = "image/tiff";
  const auto raster = rasterOf(view.store(), view.surface(), view.mission()->origin);
  if (!raster) {
    out.why = "the map has no surface yet";
    return out;
  }
  out.bytes = name == "elevation.tif" ? elevationTiff(*raster) : colourTiff(*raster);
  return out;
}

void ExportFiles::save(ModelView& view) {
  trouble_.clear();
  const bool origin = view.mission().has_value();
  const bool all = origin != saved_origin_ || view.epoch() != saved_epoch_;
  const bool map = all || view.store().version() != saved_map_;
  const bool track = all || view.track().size() != saved_track_;
  try {
    for (const std::string_view name : kExportNames) {
      if (!(name == "track.geojson" ? track : map)) continue;
      const Export file = makeExport(view, name);
      if (!file.bytes.empty()) writeFile(folder_ / name, file.bytes);
    }
  } catch (const std::exception& error) {
    trouble_ = error.what();
    return;
  }
  saved_epoch_ = view.epoch();
  saved_map_ = view.store().version();
  saved_track_ = view.track().size();
  saved_origin_ = origin;
}

}  // namespace fathom::monitor
