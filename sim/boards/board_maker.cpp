#include "sim/boards/board_maker.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/scenario/random.hpp"
#include "sim/sea/photograph.hpp"
#include "sim/sea/sea_terrain.hpp"

namespace fathom::sim {
namespace {

// Whether both images contain the board with its outer squares, which the detector needs.
bool inside(const StereoRig& rig, const calibration::Chessboard& board, const SE3& T_left_board) {
  constexpr double kMargin = 3;    // [px]
  constexpr double kWidest = 1.2;  // tangent off the axis; beyond, distortion may fold back into the image
  for (const int x : {-1, board.columns})
    for (const int y : {-1, board.rows}) {
      const Eigen::Vector3d in_left = T_left_board * Eigen::Vector3d(x * board.square, y * board.square, 0);
      const Eigen::Vector3d in_right = rig.T_right_left * in_left;
      if (in_left.z() <= 0 || in_right.z() <= 0 || in_left.head<2>().norm() > kWidest * in_left.z() ||
          in_right.head<2>().norm() > kWidest * in_right.z() ||
          !rig.left.contains(rig.left.project(in_left), kMargin) ||
          !rig.right.contains(rig.right.project(in_right), kMargin))
        return false;
    }
  return true;
}

SE3 draw(Random& random, const StereoRig& rig, const calibration::Chessboard& board,
         const BoardPoseConfig& config) {
  const double z = config.distance * random.uniform(BoardPoseConfig::kNearest, BoardPoseConfig::kFarthest);
  const Eigen::Vector2d pixel(random.uniform(0, rig.left.width), random.uniform(0, rig.left.height));
  const double heading = random.uniform(0, 2 * std::numbers::pi), tilt = random.uniform(0, config.max_tilt);
  const Eigen::AngleAxisd tilted(tilt, Eigen::Vector3d(std::cos(heading), std::sin(heading), 0));
  const Eigen::AngleAxisd roll(random.uniform(-config.max_roll, config.max_roll), Eigen::Vector3d::UnitZ());
  const Eigen::Quaterniond rotation = tilted * roll;
  const Eigen::Vector3d middle(0.5 * (board.columns - 1) * board.square,
                               0.5 * (board.rows - 1) * board.square, 0);
  return {rotation, z * rig.left.ray(pixel) - rotation * middle};
}

}  // namespace

std::vector<SE3> boardPoses(const StereoRig& rig, const calibration::Chessboard& board,
                            const BoardPoseConfig& config) {
  Random random(config.seed, "board-poses");
  const Eigen::Vector3d middle(0.5 * (board.columns - 1) * board.square,
                               0.5 * (board.rows - 1) * board.square, 0);
  std::vector<SE3> poses;
  for (int view = 0; view < config.views; ++view) {
    // The aim cycles through nine places: centre, middles of the edges and corners of the image.
    const Eigen::Vector2d aim(0.5 * (view % 3) * rig.left.width, 0.5 * (view / 3 % 3) * rig.left.height);
    constexpr int kGood = 12, kTries = 20000;  // of the fitting poses, the nearest to the aim is used
    double nearest = std::numeric_limits<double>::infinity();
    SE3 best;
    int good = 0;
    for (int t = 0; t < kTries && good < kGood; ++t) {
      const SE3 pose = draw(random, rig, board, config);
      if (!inside(rig, board, pose)) continue;
      ++good;
      const double off = (rig.left.project(pose * middle) - aim).norm();
      if (off < nearest) nearest = off, best = pose;
    }
    if (good == 0)
      throw InputError(
          "--board", "",
          "does not fit into both images at this distance; take smaller squares or go farther away");
    poses.push_back(best);
  }
  return poses;
}

namespace {

constexpr double kDepth = 10.0;       // of the board's middle [m]; any
constexpr int kTexelsPerSquare = 64;  // halved four times, a square still has whole texels
constexpr int kWhiteMargin = 1;       // around the squares, in squares
// sRGB of matt print under water: albedo of about 0.8 and 0.03.
constexpr int kWhite = 231, kBlack = 49;

cv::Mat drawBoard(const calibration::Chessboard& board) {
  const int across = board.columns + 1 + 2 * kWhiteMargin, down = board.rows + 1 + 2 * kWhiteMargin;
  cv::Mat image(down * kTexelsPerSquare, across * kTexelsPerSquare, CV_8UC1, cv::Scalar(kWhite));
  for (int y = 0; y <= board.rows; ++y)
    for (int x = 0; x <= board.columns; ++x)
      if ((x + y) % 2 == 0)
        image(cv::Rect((x + kWhiteMargin) * kTexelsPerSquare, (y + kWhiteMargin) * kTexelsPerSquare,
                       kTexelsPerSquare, kTexelsPerSquare)) = kBlack;
  return image;
}

// Pose of the board (first inner corner, x along the rows, z away from its printed side) in the nav frame of
// makeBoardTerrain().
SE3 boardInTerrain(const calibration::Chessboard& board) {
  return {Eigen::Quaterniond::Identity(),
          {-0.5 * (board.columns - 1) * board.square, -0.5 * (board.rows - 1) * board.square, kDepth}};
}

// A chessboard in open water: a plane with the board's squares as texture and a white margin one square wide.
// Writes board.ply and board.png into `folder` and gives the terrain that reads them. Edges of squares
// coincide with edges of texels at every level of the texture, so that the renderer's filter (about one
// pixel) smooths them without moving them.
TerrainConfig makeBoardTerrain(const calibration::Chessboard& board, const std::filesystem::path& folder) {
  TerrainConfig terrain;
  terrain.kind = TerrainKind::kMesh;
  terrain.base_depth_m = kDepth;
  terrain.detail_contrast = 0;
  terrain.mesh_file = folder / "board.ply";
  terrain.texture_file = folder / "board.png";
  const auto half_x = static_cast<float>(0.5 * (board.columns + 1 + 2 * kWhiteMargin) * board.square);
  const auto half_y = static_cast<float>(0.5 * (board.rows + 1 + 2 * kWhiteMargin) * board.square);
  const auto z = static_cast<float>(kDepth);
  Mesh mesh;
  mesh.vertices = {{-half_x, -half_y, z}, {half_x, -half_y, z}, {half_x, half_y, z}, {-half_x, half_y, z}};
  mesh.normals.assign(4, {0, 0, -1});
  mesh.texture_coordinates = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};  // t upwards: the first row at t = 1
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};                      // counter-clockwise from above
  writePly(terrain.mesh_file, mesh, {"chessboard in nav: north, east, down [m]"});
  if (!cv::imwrite(terrain.texture_file.string(), drawBoard(board)))
    throw std::runtime_error(terrain.texture_file.string() + ": cannot be written");
  return terrain;
}

constexpr std::array<std::string_view, 2> kFolders{"img", "truth"};
constexpr std::array<std::string_view, 2> kOwnFiles{
    "img/PR_+([0-9])_+([0-9])_+([0-9])_@(LC|RM)16.tif",
    "truth/@(stereo.calib?(.ports)|poses.csv|corners.csv|board.@(ply|png))"};
constexpr std::int64_t kBetweenViews = kSecond_ns;  // [ns]
// Fraction of full scale of white at the nearest distance. Tilts towards the strobes and the strongest colour
// channel stay below saturation, which would move edges.
constexpr double kWhiteExposure = 0.6;

std::string imageName(const Scenario& scenario, std::size_t view, CameraSide side) {
  return io::imageFileName(scenario.start_utc_ns + static_cast<std::int64_t>(view) * kBetweenViews, side);
}

void writeBoardTruth(const std::filesystem::path& folder, const Scenario& scenario, const StereoRig& rig,
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

void makeBoardFolder(const Scenario& scenario, const BoardMakerOptions& options) {
  const StereoRig rig = scenario.stereoRig();
  const std::vector<SE3> poses = boardPoses(rig, options.board, options.poses);
  OutputFolder folder(options.out, kOwnFiles);
  for (const std::string_view part : kFolders) std::filesystem::create_directories(folder.path() / part);
  writeBoardTruth(folder.path() / "truth", scenario, rig, options.board, poses);

  const SeaTerrain terrain(makeBoardTerrain(options.board, folder.path() / "truth"));
  OpticsConfig optics = scenario.optics;
  optics.sensor.exposure = kWhiteExposure;
  optics.sensor.exposure_distance_m = BoardPoseConfig::kNearest * options.poses.distance;
  const SE3 T_body_cam = scenario.T_body_cam();
  const Renderer renderer(terrain, optics, rig, T_body_cam);
  const SE3 T_nav_board = boardInTerrain(options.board);
  forEachPair(poses.size(), options.progress, [&](std::size_t v) {
    const SE3 T_nav_body = T_nav_board * poses[v].inverse() * T_body_cam.inverse();
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const std::string name = imageName(scenario, v, side);
      photograph(renderer, T_nav_body, 0.0, side, streamSeed(options.poses.seed, name),
                 folder.path() / "img" / name);
    }
  });
  folder.commit();
}

}  // namespace

void makeBoards(const Scenario& scenario, const BoardMakerOptions& options) {
  withThreads(options.threads, [&] { makeBoardFolder(scenario, options); });
}

}  // namespace fathom::sim
