#include "sim/boards/board_scene.hpp"

#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "recon/geometry/mesh_io.hpp"

namespace fathom::sim {
namespace {

constexpr double kDepth = 10.0;       // of the board's middle [m]; any
constexpr int kTexelsPerSquare = 64;  // halved four times, a square still has whole texels
constexpr int kMargin = 1;            // of white, in squares
// sRGB of matt print under water: albedo of about 0.8 and 0.03.
constexpr int kWhite = 231, kBlack = 49;

cv::Mat drawBoard(const calibration::Chessboard& board) {
  const int across = board.columns + 1 + 2 * kMargin, down = board.rows + 1 + 2 * kMargin;
  cv::Mat image(down * kTexelsPerSquare, across * kTexelsPerSquare, CV_8UC1, cv::Scalar(kWhite));
  for (int y = 0; y <= board.rows; ++y)
    for (int x = 0; x <= board.columns; ++x)
      if ((x + y) % 2 == 0)
        image(cv::Rect((x + kMargin) * kTexelsPerSquare, (y + kMargin) * kTexelsPerSquare, kTexelsPerSquare,
                       kTexelsPerSquare)) = kBlack;
  return image;
}

}  // namespace

SE3 boardInTerrain(const calibration::Chessboard& board) {
  return {Eigen::Quaterniond::Identity(),
          {-0.5 * (board.columns - 1) * board.square, -0.5 * (board.rows - 1) * board.square, kDepth}};
}

TerrainConfig makeBoardTerrain(const calibration::Chessboard& board, const std::filesystem::path& folder) {
  TerrainConfig terrain;
  terrain.kind = TerrainKind::kMesh;
  terrain.base_depth_m = kDepth;
  terrain.detail_contrast = 0;
  terrain.mesh_file = folder / "board.ply";
  terrain.texture_file = folder / "board.png";
  const auto half_x = static_cast<float>(0.5 * (board.columns + 1 + 2 * kMargin) * board.square);
  const auto half_y = static_cast<float>(0.5 * (board.rows + 1 + 2 * kMargin) * board.square);
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

}  // namespace fathom::sim
