#include "sim/boards/board_maker.hpp"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

#include "firmware_if/files/images/image_file.hpp"
#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/output_folder.hpp"
#include "sim/boards/board_scene.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sea/photograph.hpp"
#include "sim/sea/terrain.hpp"

namespace fathom::sim {
namespace {

constexpr std::array<std::string_view, 2> kFolders{"img", "truth"};
constexpr std::array<std::string_view, 2> kOurs{
    "img/PR_+([0-9])_+([0-9])_+([0-9])_@(LC|RM)16.tif",
    "truth/@(stereo.calib?(.ports)|poses.csv|corners.csv|board.@(ply|png))"};
constexpr std::int64_t kBetweenViews = 1'000'000'000;  // [ns]
// Fraction of full scale of white at the nearest distance, left after a tilt towards the strobes and the
// strongest colour: nothing saturates, so that no edge moves.
constexpr double kExposure = 0.6;
constexpr double kNearest = 0.75;  // of the distance, as boardPoses draws it

std::string imageName(const Scenario& scenario, std::size_t view, CameraSide side) {
  return io::imageFileName(scenario.start_utc_ns + static_cast<std::int64_t>(view) * kBetweenViews, side);
}

void writeTruth(const std::filesystem::path& folder, const Scenario& scenario, const StereoRig& rig,
                const calibration::Chessboard& board, const std::vector<SE3>& poses) {
  writeStereoCalib(folder / "stereo.calib", rig);
  AtomicFile pose_file(folder / "poses.csv"), corner_file(folder / "corners.csv");
  pose_file.stream() << "view,left_image,right_image,x_m,y_m,z_m,qw,qx,qy,qz\n";
  corner_file.stream() << "view,corner,u_left,v_left,u_right,v_right,x_m,y_m,z_m\n";
  const std::vector<Eigen::Vector3d> points = calibration::boardPoints(board);
  for (std::size_t v = 0; v < poses.size(); ++v) {
    const Eigen::Vector3d& t = poses[v].translation();
    const Eigen::Quaterniond& q = poses[v].rotation();
    pose_file.stream() << formatted("%zu,%s,%s,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n", v + 1,
                                    imageName(scenario, v, CameraSide::kLeft).c_str(),
                                    imageName(scenario, v, CameraSide::kRight).c_str(), t.x(), t.y(), t.z(),
                                    q.w(), q.x(), q.y(), q.z());
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Eigen::Vector3d p = poses[v] * points[k];
      const Eigen::Vector2d left = rig.left.project(p), right = rig.right.project(rig.T_right_left * p);
      corner_file.stream() << formatted("%zu,%zu,%.6f,%.6f,%.6f,%.6f,%.9f,%.9f,%.9f\n", v + 1, k, left.x(),
                                        left.y(), right.x(), right.y(), p.x(), p.y(), p.z());
    }
  }
  pose_file.commit();
  corner_file.commit();
}

void make(const Scenario& scenario, const BoardMakerOptions& options) {
  const StereoRig rig = scenario.stereoRig();
  const std::vector<SE3> poses = boardPoses(rig, options.board, options.poses);
  OutputFolder folder(options.out, kOurs);
  for (const std::string_view part : kFolders) std::filesystem::create_directories(folder.path() / part);
  writeTruth(folder.path() / "truth", scenario, rig, options.board, poses);

  const Terrain terrain(makeBoardTerrain(options.board, folder.path() / "truth"));
  OpticsConfig optics = scenario.optics;
  optics.sensor.exposure = kExposure;
  optics.sensor.exposure_distance_m = kNearest * options.poses.distance;
  const SE3 T_body_cam = scenario.T_body_cam();
  const Renderer renderer(terrain, optics, rig, T_body_cam);
  const SE3 T_nav_board = boardInTerrain(options.board);
  std::mutex mutex;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, poses.size(), [&](std::size_t v) {
    // Isolated, so that a thread that waits inside one image does not begin another.
    tbb::this_task_arena::isolate([&] {
      const SE3 T_nav_body = T_nav_board * poses[v].inverse() * T_body_cam.inverse();
      for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
        const std::string name = imageName(scenario, v, side);
        photograph(renderer, T_nav_body, 0.0, side, streamSeed(options.poses.seed, name),
                   folder.path() / "img" / name);
      }
    });
    const std::lock_guard lock(mutex);
    ++done;
    if (options.progress) options.progress(done, poses.size());
  });
  folder.commit();
}

}  // namespace

void makeBoards(const Scenario& scenario, const BoardMakerOptions& options) {
  const int threads = options.threads > 0
                          ? options.threads
                          : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] { make(scenario, options); });
}

}  // namespace fathom::sim
