#include "recon/topside/pipeline.hpp"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>

#include <Eigen/Geometry>
#include <array>
#include <string_view>

#include "firmware_if/mission.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/output_folder.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/report/map_picture.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/report.hpp"
#include "recon/topside/stages/fuse_stage.hpp"
#include "recon/topside/stages/given_pair_stage.hpp"
#include "recon/topside/stages/lighting_stage.hpp"
#include "recon/topside/stages/mesh_pieces.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/stages/prepare_stage.hpp"
#include "recon/topside/stages/slam_stage.hpp"
#include "recon/topside/stages/stereo_stage.hpp"

namespace fathom::topside {
namespace {

constexpr int kPicturePixels = 1400;   // longer side of the report's pictures
constexpr double kPixelsPerVoxel = 6;  // at most: a small map is drawn large enough to look at

// What topside/ of a mission folder may hold.
constexpr std::array<std::string_view, 9> kOurs = {"stereo_pose_est.data",
                                                   "vehicle_pose_est.data",
                                                   "closures.csv",
                                                   "mesh.ply",
                                                   "mesh.png",
                                                   "tiles",
                                                   "layers",
                                                   "report.json",
                                                   "report.html"};

double areaOf(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area +=
        0.5 * static_cast<double>(
                  (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm());
  return area;
}

void writeBytes(const std::filesystem::path& path, const std::string& bytes) {
  AtomicFile file(path);
  file.stream().write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.commit();
}

[[noreturn]] void refuse(const io::MissionPaths& paths, const FuseCounts& counts, std::size_t listed) {
  std::string why = "no usable stereo pair of " + std::to_string(listed) + ": " +
                    std::to_string(counts.unreadable) + " unreadable, " +
                    std::to_string(counts.without_pose) + " outside the navigation, " +
                    std::to_string(counts.too_few_points) + " with too few points";
  if (!counts.unreadable_lines.empty()) why += "; the first: " + counts.unreadable_lines.front();
  throw InputError(paths.root.string(), "img", why);
}

}  // namespace

Summary runTopside(const std::filesystem::path& mission_folder, const std::filesystem::path& out_folder,
                   const TopsideConfig& config) {
  namespace tbb = oneapi::tbb;
  const int threads = config.threads > 0 ? config.threads : tbb::info::default_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  Stopwatch total, stage;
  RunRecord record;
  const auto lap = [&](const char* name) { record.stage_seconds.emplace_back(name, stage.lap()); };

  const io::MissionPaths paths(mission_folder);
  const io::MissionConfig mission = io::readMissionConfig(mission_folder);
  const StereoRig rig = readStereoCalib(paths.calib());
  OutputFolder out(out_folder, kOurs);
  const PairList list = listPairs(paths, mission, config.pairing_tolerance);
  std::vector<std::int64_t> times;
  for (const ImagePair& pair : list.pairs) times.push_back(pair.utc_ns);
  const Navigation navigation = navigate(paths, mission, config, times);
  lap("navigation");

  LightingModels lighting(mission, rig, config.lighting);
  if (!list.features_only) learnLighting(paths, mission, rig, list.pairs, navigation.poses, config, lighting);
  lap("lighting model");

  SlamResult slam;
  if (config.slam) {
    const MemoryFeatureStore features =
        prepareFeatures(paths, mission, rig, config, lighting, list, navigation);
    lap("features");
    slam = localise(mission, rig, config, navigation, features);
  }
  const std::vector<NavigatedPose>& poses = config.slam ? slam.poses : navigation.poses;
  if (config.slam) lap("localisation");

  fusion::VolumetricFusion fusion(config.fusion);
  const FuseResult fused = [&] {
    Progress progress("stereo", list.pairs.size());
    return fusePairs(
        list.pairs, poses,
        [&]() -> std::unique_ptr<PairMesher> {
          if (list.features_only) return std::make_unique<GivenPairStage>(paths, mission, rig, config);
          return std::make_unique<StereoStage>(paths, mission, rig, config, lighting);
        },
        config.default_altitude, fusion, progress);
  }();
  lap("stereo and fusion");

  Mesh mesh = fusion.extract();
  record.pieces_dropped = dropSmallPieces(mesh, config.min_component);
  if (mesh.empty()) refuse(paths, fused.counts, list.pairs.size());
  lap("surface");

  writePly(out.path() / "mesh.ply", mesh,
           {"fathom-topside " FATHOM_VERSION, "nav: north, east, down [m] from the mission's origin"});
  writePoses(out.path(), mission.origin, fused.pairs);
  if (config.slam) writeClosures(out.path() / "closures.csv", list.pairs, slam.closures);
  const MapPicture picture = drawFromAbove(mesh, kPicturePixels, config.fusion.voxel / kPixelsPerVoxel);
  writeBytes(out.path() / "mesh.png", toPng(picture.rgb, picture.width, picture.height));
  lap("output");

  record.mission = mission_folder.string();
  record.vehicle = mission.vehicle_name;
  record.dive_id = mission.dive_id;
  record.software_version = FATHOM_VERSION;
  record.threads = threads;
  record.config = &config;
  record.list = &list;
  record.navigation = &navigation;
  record.fused = &fused;
  record.slam = config.slam ? &slam : nullptr;
  record.fusion = fusion.counters();
  record.fusion_bytes = fusion.memoryBytes();
  record.left_lighting = lighting.left.report();
  record.right_lighting = lighting.right.report();
  record.lighting_unreadable = lighting.unreadable;
  record.vertices = mesh.vertices.size();
  record.triangles = mesh.triangles.size();
  record.area = areaOf(mesh);
  record.total_seconds = total.lap();
  writeReportJson(out.path() / "report.json", record);
  writeReportHtml(out.path() / "report.html", record, picture);
  out.commit();
  return {list.pairs.size(), fused.counts.used, fused.counts.unreadable,
          record.triangles,  record.area,       record.total_seconds};
}

}  // namespace fathom::topside
