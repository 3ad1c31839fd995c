#include "tests/bench/accuracy/model_accuracy.hpp"

#include "firmware_if/files/mission.hpp"
#include "firmware_if/files/pose_files.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/score/surface_score.hpp"
#include "sim/score/trajectory_score.hpp"
#include "tests/bench/common/measures.hpp"

namespace fathom::accuracy {
namespace {

constexpr std::size_t kWindows = 20;   // of a level, at most about
constexpr int kPictureLongest = 1000;  // [px]

}  // namespace

ModelAccuracy measureModel(const std::filesystem::path& mission_folder, const std::filesystem::path& results,
                           const std::filesystem::path& pictures) {
  const io::MissionPaths paths(mission_folder);
  const io::MissionConfig mission = io::readMissionConfig(mission_folder);
  const StereoRig rig = readStereoCalib(paths.calib());
  const sim::TruthTrack track(paths.truth());
  const ModelTiles tiles(results / "tiles");
  const sim::TruthSurface truth(readPly(paths.truth() / "terrain.ply"));
  const sim::Scenario scenario = sim::loadScenario((paths.truth() / "scenario.toml").string());
  const sim::Terrain terrain(sim::resolvedTerrain(scenario));
  const sim::Appearance appearance(terrain);

  std::vector<SE3> poses;
  for (const std::int64_t utc_ns : track.exposures())
    if (const auto pose = track.poseAt(utc_ns)) poses.push_back(*pose * mission.T_body_cam);
  const sim::SeenSeafloor seen = sim::seenSeafloor(truth, rig.left, poses);
  const sim::CameraTracks tracks =
      sim::pairTracks(io::readStereoPoses(results / "stereo_pose_est.data"), track, mission);
  const SE3 start = sim::alignLevel(tracks.estimate, tracks.truth);

  ModelAccuracy out;
  for (const int level : tiles.levels()) {
    LevelAccuracy l;
    l.level = level;
    const Mesh mesh = tiles.surfaceOf(level);
    l.tiles = tiles.filesOf(level).size();
    l.triangles = mesh.triangles.size();
    l.area = bench::areaOf(mesh);
    l.surface = sim::scoreSurface(mesh, truth, seen, start);
    if (out.levels.empty()) out.alignment = l.surface.alignment;
    l.texture = textureErrorOf(tiles, level, appearance, out.alignment, kWindows);
    if (!pictures.empty() && l.texture.windows > 0)
      drawWindowBesideTruth(tiles, level, appearance, out.alignment,
                            pictures / ("level_" + std::to_string(level) + ".png"));
    out.levels.push_back(std::move(l));
  }
  if (!pictures.empty())
    drawBesideTruth(tiles, appearance, out.alignment, kPictureLongest, pictures / "beside_truth.png");
  return out;
}

}  // namespace fathom::accuracy
