#include "tests/bench/accuracy/fusion_variants.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <array>
#include <cmath>
#include <map>
#include <memory>

#include "firmware_if/files/mission.hpp"
#include "firmware_if/files/pose_files.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/topside/input/images/image_pairs.hpp"
#include "recon/topside/input/seed_plane.hpp"
#include "recon/topside/light/lighting_stage.hpp"
#include "recon/topside/prepare/pair_preparer.hpp"
#include "sim/score/surface_score.hpp"
#include "sim/score/trajectory_score.hpp"

namespace fathom::accuracy {
namespace {

namespace tbb = oneapi::tbb;
using topside::ImagePair;

enum Which : std::size_t { kMeasured, kTruePoses, kTruePoints, kOracle, kDense, kVariants };
constexpr std::array<const char*, kVariants> kNames = {
    "measured points, estimated poses", "measured points, true poses", "true points, estimated poses",
    "true points, true poses (oracle)", "dense true points, true poses"};

struct Poses {
  SE3 estimated, truth;  // T_nav_cam
};

struct Sums {
  std::size_t points = 0, beyond_limit = 0, edges = 0;
  double squared = 0, plain = 0, over_sigma = 0, edge = 0;
};

struct Job {
  std::size_t index = 0;
  std::array<Mesh, kVariants> meshes;
  Sums sums;
};

Mesh placed(Mesh mesh, const SE3& T_nav_cam) {
  transform(mesh, T_nav_cam);
  return mesh;
}

// Each vertex moved along its line of sight to the true surface; where that sees nothing it stays.
Mesh withTrueDepths(const Mesh& local, const sim::TruthSurface& truth, const SE3& T_nav_cam, Sums& sums) {
  Mesh out = local;
  for (std::size_t i = 0; i < local.vertices.size(); ++i) {
    const Eigen::Vector3d v = local.vertices[i].cast<double>();
    const auto hit = truth.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * v);
    if (!hit) continue;
    const double range = (*hit - T_nav_cam.translation()).norm(), error = v.norm() - range;
    out.vertices[i] = (v * (range / v.norm())).cast<float>();
    ++sums.points;
    if (std::abs(error) > PointErrors::kLimit) {
      ++sums.beyond_limit;
      continue;
    }
    sums.squared += error * error;
    sums.plain += error;
    const double ratio = error / static_cast<double>(local.sigma[i]);
    sums.over_sigma += ratio * ratio;
  }
  for (const auto& t : local.triangles)
    for (std::size_t k = 0; k < 3; ++k, ++sums.edges)
      sums.edge += static_cast<double>((local.vertices[t[k]] - local.vertices[t[(k + 1) % 3]]).norm());
  return out;
}

// A lattice over the whole image, its points on the true surface; cells that reach over a step are left out.
Mesh denseTruth(const Camera& camera, const sim::TruthSurface& truth, const SE3& T_nav_cam, double spacing,
                float sigma) {
  constexpr double kMinCosine = 0.17;  // between a cell and its line of sight: about 80 degrees
  const Eigen::Vector3d down = T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ();
  const auto middle = truth.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * down);
  if (!middle) return {};
  const double range = (*middle - T_nav_cam.translation()).norm();
  const int step = std::max(2, static_cast<int>(spacing * camera.fx / range));
  const int columns = camera.width / step + 1, rows = camera.height / step + 1;
  std::vector<std::int64_t> index(static_cast<std::size_t>(columns * rows), -1);
  Mesh mesh;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const Eigen::Vector3d ray = camera.ray({static_cast<double>(std::min(column * step, camera.width - 1)),
                                              static_cast<double>(std::min(row * step, camera.height - 1))});
      const auto hit = truth.castRay(T_nav_cam.translation(), T_nav_cam.rotation() * ray);
      if (!hit) continue;
      index[static_cast<std::size_t>(row * columns + column)] =
          static_cast<std::int64_t>(mesh.vertices.size());
      const double length = (*hit - T_nav_cam.translation()).norm();
      mesh.vertices.emplace_back((ray.normalized() * length).cast<float>());
      mesh.sigma.push_back(sigma);
    }
  }
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    if (index[a] < 0 || index[b] < 0 || index[c] < 0) return;
    const std::array<std::uint32_t, 3> t = {static_cast<std::uint32_t>(index[a]),
                                            static_cast<std::uint32_t>(index[b]),
                                            static_cast<std::uint32_t>(index[c])};
    const Eigen::Vector3f p = mesh.vertices[t[0]];
    const Eigen::Vector3f normal = (mesh.vertices[t[1]] - p).cross(mesh.vertices[t[2]] - p);
    if (-normal.normalized().dot(p.normalized()) > static_cast<float>(kMinCosine))
      mesh.triangles.push_back(t);
  };
  for (int row = 0; row + 1 < rows; ++row) {
    for (int column = 0; column + 1 < columns; ++column) {
      const auto at = static_cast<std::size_t>(row * columns + column);
      const std::size_t below = at + static_cast<std::size_t>(columns);
      add(at, below, at + 1);
      add(at + 1, below, below + 1);
    }
  }
  return mesh;
}

// All leaf tiles as one mesh; vertices on their borders stand twice.
Mesh surfaceOf(const fusion::VolumetricFusion& volume, double voxel) {
  TileGrid grid;
  grid.voxel = voxel;
  Mesh all;
  for (const TileMesh& tile : volume.extractTiles(grid)) {
    const auto first = static_cast<std::uint32_t>(all.vertices.size());
    all.vertices.insert(all.vertices.end(), tile.mesh.vertices.begin(), tile.mesh.vertices.end());
    for (const auto& t : tile.mesh.triangles)
      all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  return all;
}

}  // namespace

VariantReport fuseVariants(const std::filesystem::path& mission_folder,
                           const std::filesystem::path& pose_file, const topside::TopsideConfig& config) {
  const topside::MissionInput input = topside::openMission(mission_folder, {});
  const io::MissionConfig& mission = input.mission;
  const StereoRig& rig = input.rig;
  const sim::TruthTrack track(input.paths.truth());
  if (input.features_only)
    throw InputError(mission_folder.string(), "img",
                     "is absent: the points of a rendered mission are needed");
  const topside::Survey survey = topside::takeSurvey(input, config);
  const topside::PairList& list = survey.list;
  topside::LightingModels lighting(input, config.lighting);
  topside::learnLighting(input, config, survey, lighting);

  std::map<std::string, SE3> estimated;
  const io::StereoPoseFile file = io::readStereoPoses(pose_file);
  for (const io::StereoPose& pose : file.poses) estimated[pose.left_image] = pose.T_nav_cam;
  const sim::CameraTracks tracks = sim::pairTracks(file, track, mission);
  const SE3 level = sim::alignLevel(tracks.estimate, tracks.truth);
  VariantReport report;
  for (std::size_t i = 0; i < tracks.truth.size(); ++i)
    report.pose_rms += (level * tracks.estimate[i] - tracks.truth[i]).squaredNorm();
  report.pose_rms =
      std::sqrt(report.pose_rms / static_cast<double>(std::max<std::size_t>(tracks.truth.size(), 1)));

  std::vector<std::pair<std::size_t, Poses>> usable;
  std::vector<SE3> true_poses;
  for (std::size_t i = 0; i < list.pairs.size(); ++i) {
    const auto pose = estimated.find(list.pairs[i].left);
    const auto utc_ns = track.exposureOf(list.pairs[i].left);
    if (pose == estimated.end() || !utc_ns || !survey.planes[i]) continue;
    const auto T_nav_body = track.poseAt(*utc_ns);
    if (!T_nav_body) continue;
    usable.push_back({i, {pose->second, *T_nav_body * mission.T_body_cam}});
    true_poses.push_back(usable.back().second.truth);
  }
  if (usable.empty())
    throw InputError(pose_file.string(), "", "names no image of the mission; run fathom-topside on it first");

  const sim::TruthSurface truth(readPly(input.paths.truth() / "terrain.ply"));
  std::array<std::unique_ptr<fusion::VolumetricFusion>, kVariants> volumes;
  for (auto& volume : volumes) volume = std::make_unique<fusion::VolumetricFusion>(config.fusion);
  tbb::enumerable_thread_specific<std::unique_ptr<topside::PairPreparer>> preparers;
  Sums sums;
  {
    rt::StageProgress progress("stereo", usable.size());
    std::size_t next = 0;
    tbb::parallel_pipeline(
        static_cast<std::size_t>(2 * tbb::info::default_concurrency()),
        tbb::make_filter<void, std::shared_ptr<Job>>(tbb::filter_mode::serial_in_order,
                                                     [&](tbb::flow_control& flow) -> std::shared_ptr<Job> {
                                                       if (next == usable.size()) {
                                                         flow.stop();
                                                         return nullptr;
                                                       }
                                                       auto job = std::make_shared<Job>();
                                                       job->index = next++;
                                                       return job;
                                                     }) &
            tbb::make_filter<std::shared_ptr<Job>, std::shared_ptr<Job>>(
                tbb::filter_mode::parallel,
                [&](const std::shared_ptr<Job>& job) {
                  const auto& [pair, poses] = usable[job->index];
                  std::unique_ptr<topside::PairPreparer>& preparer = preparers.local();
                  if (!preparer) preparer = topside::makePreparer(input, config, lighting, false);
                  const Mesh local = preparer->process(list.pairs[pair], *survey.planes[pair]).mesh;
                  if (local.empty()) return job;
                  const Mesh ideal = withTrueDepths(local, truth, poses.truth, job->sums);
                  job->meshes[kMeasured] = placed(local, poses.estimated);
                  job->meshes[kTruePoses] = placed(local, poses.truth);
                  job->meshes[kTruePoints] = placed(ideal, poses.estimated);
                  job->meshes[kOracle] = placed(ideal, poses.truth);
                  constexpr float kSigma = 0.003F;  // as good as stereo's better points [m]
                  job->meshes[kDense] =
                      placed(denseTruth(rig.left, truth, poses.truth, 0.5 * config.fusion.voxel, kSigma),
                             poses.truth);
                  return job;
                }) &
            tbb::make_filter<std::shared_ptr<Job>, void>(
                tbb::filter_mode::serial_in_order, [&](const std::shared_ptr<Job>& job) {
                  const Poses& poses = usable[job->index].second;
                  for (std::size_t v = 0; v < kVariants; ++v) {
                    if (job->meshes[v].empty()) continue;
                    const bool at_estimate = v == kMeasured || v == kTruePoints;
                    volumes[v]->integrate(job->meshes[v],
                                          (at_estimate ? poses.estimated : poses.truth).translation());
                  }
                  sums.points += job->sums.points;
                  sums.beyond_limit += job->sums.beyond_limit;
                  sums.edges += job->sums.edges;
                  sums.squared += job->sums.squared;
                  sums.plain += job->sums.plain;
                  sums.over_sigma += job->sums.over_sigma;
                  sums.edge += job->sums.edge;
                  progress.step();
                }));
  }
  const double near = static_cast<double>(std::max<std::size_t>(sums.points - sums.beyond_limit, 1));
  report.points = {sums.points, sums.beyond_limit, std::sqrt(sums.squared / near), sums.plain / near,
                   std::sqrt(sums.over_sigma / near)};
  report.triangle_edge = sums.edge / static_cast<double>(std::max<std::size_t>(sums.edges, 1));

  const sim::SeenSeafloor seen = sim::seenSeafloor(truth, rig.left, true_poses);
  for (std::size_t v = 0; v < kVariants; ++v) {
    Variant variant{kNames[v], surfaceOf(*volumes[v], config.fusion.voxel), {}};
    volumes[v].reset();
    if (variant.mesh.empty()) throw InputError(mission_folder.string(), "img", "gives no surface");
    variant.score =
        sim::scoreSurface(variant.mesh, truth, seen, v == kMeasured || v == kTruePoints ? level : SE3());
    report.variants.push_back(std::move(variant));
  }
  return report;
}

}  // namespace fathom::accuracy
