#include "recon/topside/assemble/assemble.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "firmware_if/mission/feature_file.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/products/tables/dive_tables.hpp"
#include "recon/products/tiles/model_file.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "recon/topside/report/pose_output.hpp"

namespace fathom::topside {
namespace {

// How localisation moved a pose in nav.
struct Correction {
  std::int64_t utc_ns = 0;
  SE3 moved;
};

std::vector<Correction> correctionsOf(const std::vector<NavigatedPose>& before,
                                      const std::vector<NavigatedPose>& after) {
  std::vector<Correction> out;
  for (std::size_t k = 0; k < before.size(); ++k)
    if (before[k].T_nav_body && after[k].T_nav_body)
      out.push_back({before[k].utc_ns, *after[k].T_nav_body * before[k].T_nav_body->inverse()});
  return out;
}

// `moved` turns about nav's origin, which may be far away: the vehicle's own place and attitude are moved
// instead.
SE3 correctedAt(const std::vector<Correction>& all, std::int64_t utc_ns, const SE3& pose) {
  if (all.empty()) return pose;
  const auto next = std::lower_bound(all.begin(), all.end(), utc_ns,
                                     [](const Correction& c, std::int64_t t) { return c.utc_ns < t; });
  if (next == all.begin()) return next->moved * pose;
  const auto last = next - 1;
  if (next == all.end()) return last->moved * pose;
  const double s =
      static_cast<double>(utc_ns - last->utc_ns) / static_cast<double>(next->utc_ns - last->utc_ns);
  return interpolate(last->moved * pose, next->moved * pose, s);
}

std::optional<double> altitudeOf(const FusedPair& pair) {
  return pair.altitude > 0 ? std::optional(pair.altitude) : std::nullopt;
}

}  // namespace

std::vector<DiveTrackPoint> trackOf(Dive& dive, const FuseResult& fused, const WaterLog& water) {
  const Navigation& navigation = dive.survey().navigation;
  const std::vector<Correction> moved = correctionsOf(navigation.poses, dive.poses());
  std::vector<DiveTrackPoint> track;
  if (!dive.input().navigated) {
    const FusedPair* last = nullptr;
    for (const FusedPair& pair : fused.pairs) {
      if (last != nullptr && last->part != pair.part)
        track.push_back({std::midpoint(last->pair.utc_ns, pair.pair.utc_ns), {}, {}, "", {}});
      track.push_back({pair.pair.utc_ns, pair.T_nav_body, altitudeOf(pair), "", {}});
      last = &pair;
    }
    return track;
  }
  for (const NavigatedPose& pose : navigation.track) {
    DiveTrackPoint point;
    point.utc_ns = pose.utc_ns;
    point.altitude = pose.altitude;
    if (pose.T_nav_body) point.T_nav_body = correctedAt(moved, pose.utc_ns, *pose.T_nav_body);
    point.water = water.at(pose.utc_ns, point.T_nav_body ? point.T_nav_body->translation().z() : 0);
    track.push_back(std::move(point));
  }
  const std::vector<ImagePair>& pairs = dive.survey().list.pairs;
  nameStages(track, pairs.front().utc_ns, pairs.back().utc_ns);
  return track;
}

std::vector<ImageRow> imageRowsOf(Dive& dive, const FuseResult& fused, const WaterLog& water) {
  const MissionInput& input = dive.input();
  std::vector<ImageRow> rows;
  for (const FusedPair& pair : fused.pairs) {
    ImageRow row;
    row.left = pair.pair.left;
    row.right = pair.pair.right;
    if (input.timed()) row.utc_ns = pair.pair.utc_ns;
    row.T_nav_body = pair.T_nav_body;
    row.T_nav_cam = pair.T_nav_cam;
    row.altitude = altitudeOf(pair);
    row.footprint = footprintOnPlane(input.rig.left, pair.T_nav_cam, pair.range);
    row.water = water.at(pair.pair.utc_ns, row.T_nav_body.translation().z());
    rows.push_back(std::move(row));
  }
  return rows;
}

namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

LevelSummary writeLevel(const Dive& dive, int level, const TilePlaces& places, const fs::path& folder,
                        std::vector<TileEntry>& entries) {
  LevelSummary sum;
  sum.level = level;
  sum.texel = std::numeric_limits<double>::infinity();
  fs::create_directories(folder / std::to_string(level));
  const std::string gpu = dive.config().model.gpu_texture == GpuTexture::kDds ? ".dds" : ".ktx2";
  std::map<const WorkFile*, std::map<TileId, TileRecord>> records;
  for (const auto& [tile, file] : places) {
    auto& of_file = records[file.get()];
    if (of_file.empty())
      for (const TileRecord& record : readRecords(*file)) of_file.emplace(record.tile, record);
    const TileRecord& r = of_file.at(tile);
    const std::string name = tileName(tile);
    writeFile(folder / tilePath(tile), file->read("glb " + name));
    if (file->holds("gpu " + name)) writeFile(folder / tilePath(tile, gpu), file->read("gpu " + name));
    entries.push_back({tile, r.low, r.high, r.error, r.texel});
    ++sum.tiles;
    sum.vertices += r.vertices;
    sum.triangles += r.triangles;
    sum.area += r.area;
    sum.error = std::max(sum.error, r.error);
    sum.texel = std::min(sum.texel, r.texel);
    sum.surface_bytes += r.surface_bytes;
    sum.picture_bytes += r.picture_bytes;
    sum.gpu_bytes += r.gpu_bytes;
  }
  return sum;
}

Json layerJson(const LayerInfo& layer) {
  return {{"name", layer.name}, {"title", layer.title}, {"unit", layer.unit}, {"file", layer.file},
          {"min", layer.min},   {"max", layer.max},     {"ramp", layer.ramp}};
}

// How the left images' files are to be read.
std::string imageFormat(const MissionInput& input) {
  if (!input.described && input.samples[0] >= Samples::kRggb)
    return sampleNames()[static_cast<std::size_t>(input.samples[0])];
  const PixelFormat format = input.mission.cameras.left_format;
  return format == PixelFormat::kMono ? "mono" : format == PixelFormat::kRgb ? "rgb" : "bayer-rggb";
}

// The same for every model of these images, in whatever folder: a digest of their names and of one of them.
std::string identityOf(const MissionInput& input, const PairList& list) {
  Hasher hasher;
  for (const ImagePair& pair : list.pairs) hasher.add(pair.left);
  const std::string& first = list.pairs.front().left;
  const fs::path file = input.features_only ? input.paths.features() / io::featureFileName(first)
                                            : input.paths.images() / first;
  if (fs::is_regular_file(file)) hasher.add(digestOfFile(file));
  return hasher.finish().shortHex();
}

void writeScene(Dive& dive, const Assembled& model, const std::vector<TileEntry>& entries,
                const fs::path& out) {
  const io::MissionConfig& mission = dive.input().mission;
  Json levels = Json::array(), layers = Json::array();
  for (const LevelSummary& level : model.levels)
    levels.push_back(
        {{"level", level.level},
         {"tile_edge_m", dive.grid().edge(level.level)},
         {"triangles_per_m2", level.area > 0 ? static_cast<double>(level.triangles) / level.area : 0},
         {"texel_m", level.texel},
         {"error_m", level.error}});
  for (const LayerInfo& layer : model.layers) layers.push_back(layerJson(layer));
  Eigen::Vector3d low = entries.front().low, high = entries.front().high;
  for (const TileEntry& entry : entries) {
    low = low.cwiseMin(entry.low);
    high = high.cwiseMax(entry.high);
  }
  const io::MissionPaths& paths = dive.input().paths;
  const fs::path root = fs::absolute(paths.root).lexically_normal(),
                 images = fs::absolute(paths.images()).lexically_normal(),
                 mission_folder = fs::relative(root, out);
  const Json scene = {
      {"format", 1},
      {"name", dive.input().described ? mission.vehicle_name + " dive " + std::to_string(mission.dive_id)
                                      : mission.vehicle_name},
      {"vehicle", mission.vehicle_name},
      {"dive_id", mission.dive_id},
      {"software", "fathom-topside " FATHOM_VERSION},
      {"origin", dive.input().placed ? Json{{"latitude", mission.origin.latitude * kDegreesPerRadian},
                                            {"longitude", mission.origin.longitude * kDegreesPerRadian}}
                                     : Json()},
      {"tileset", "tiles/tileset.json"},
      {"levels", levels},
      {"layers", layers},
      {"track", "track.json"},
      {"images", "images.json"},
      {"image_folder",
       (mission_folder / images.lexically_relative(root)).lexically_normal().generic_string()},
      {"mission", mission_folder.generic_string()},
      {"image_format", imageFormat(dive.input())},
      {"image_bits", mission.cameras.bits},
      {"id", identityOf(dive.input(), dive.survey().list)},
      {"bounds", {low.x(), low.y(), high.x(), high.y()}},
      {"depth", {low.z(), high.z()}}};
  writeFile(out / "scene.json", scene.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

// The leaf tiles as one mesh, tile by tile: vertices at one place are one.
void writeMesh(const TilePlaces& leaves, const fs::path& path, Assembled& model) {
  PlyParts ply(path,
               {"fathom-topside " FATHOM_VERSION, "nav: north, east, down [m] from the mission's origin"});
  JoinedVertices joined;
  for (const auto& [tile, file] : leaves) {
    const TileMesh surface = readFeed(*file, tile).surface;
    const Mesh& mesh = surface.mesh;
    const auto [number, added] = joined.add(surface);
    Mesh part;
    for (const std::uint32_t v : added) {
      part.vertices.push_back(mesh.vertices[v]);
      if (!mesh.normals.empty()) part.normals.push_back(mesh.normals[v]);
      if (!mesh.colours.empty()) part.colours.push_back(mesh.colours[v]);
      if (!mesh.sigma.empty()) part.sigma.push_back(mesh.sigma[v]);
    }
    for (const auto& t : mesh.triangles) {
      const auto corner = [&, &of = number](std::size_t k) { return static_cast<std::uint32_t>(of[t[k]]); };
      const auto a = corner(0), b = corner(1), c = corner(2);
      if (a != b && b != c && c != a) part.triangles.push_back({a, b, c});
    }
    ply.add(part);
    model.extent.add(part);
  }
  ply.commit();
  model.vertices = ply.vertices();
  model.triangles = ply.triangles();
}

}  // namespace

Assembled assemble(Dive& dive, const FuseResult& fused, const fs::path& out) {
  Assembled model;
  const std::vector<TilePlaces>& levels = dive.levels();
  std::vector<TileEntry> entries;
  for (std::size_t k = 0; k < levels.size(); ++k)
    model.levels.push_back(writeLevel(dive, static_cast<int>(k), levels[k], out / "tiles", entries));
  const std::optional<Geodetic> origin = dive.input().origin();
  writeTilesets(out / "tiles", entries, origin);

  writeMesh(levels.front(), out / "mesh.ply", model);
  writePoses(out, dive.input().mission.origin, fused.pairs);
  if (const SlamResult* slam = dive.localised()) {
    writeClosures(out / "closures.csv", dive.survey().list.pairs, slam->closures);
    writePoseCovariances(out, dive.survey().list.pairs, *slam);
  }

  const MissionInput& input = dive.input();
  const WaterLog water(input.given_poses || !input.navigated ? std::vector<WaterSample>()
                                                             : readWater(input.paths.root));
  const std::vector<DiveTrackPoint> track = trackOf(dive, fused, water);
  const std::vector<ImageRow> rows = imageRowsOf(dive, fused, water);
  writeTrackJson(out / "track.json", track, input.timed());
  writeImagesJson(out / "images.json", rows, dive.input().rig.left);
  (void)writeImageTables(out, origin, rows);

  LayerInputs layers;
  layers.origin = origin;
  layers.grid = dive.grid();
  for (const auto& [tile, file] : levels.front()) layers.tiles.push_back(tile);
  layers.patch = [&](const TileId& tile) { return levels.front().at(tile)->read("patch " + tileName(tile)); };
  layers.statistics = &dive.plan().statistics;
  layers.track = &track;
  LayerConfig config;
  config.cells = dive.layerCells();
  model.layers = writeLayers(out, layers, config);
  writeScene(dive, model, entries, out);
  return model;
}

}  // namespace fathom::topside
