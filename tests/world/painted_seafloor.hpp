#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/surface/blend.hpp"
#include "tests/support/lattice_mesh.hpp"

namespace fathom::surface {

// A synthetic painted seafloor, flat at `depth`, with level plates above it, seen by cameras that look down.
struct SyntheticSeafloor {
  struct Plate {
    std::array<double, 4> box{};  // north, east low, then high [m]
    double depth = 0;             // [m]
    std::array<double, 3> colour{};
  };
  using Paint = std::function<std::array<double, 3>(double north, double east)>;

  Camera camera{};
  Paint paint{};
  double depth = 2;
  std::vector<Plate> plates{};  // no two above each other
  std::vector<View> views{};
  std::vector<double> gains{};       // of a view's picture; 1 where absent
  std::vector<RgbImage> pictures{};  // one a view, by take()

  // A view from a place at depth 0, turned by `yaw` and tilted by `roll` [rad].
  void addView(double north, double east, double yaw = 0, double roll = 0, double gain = 1);
  // Draws every view's picture, 2 x 2 samples a pixel. `only`: this view alone.
  void take();
  [[nodiscard]] RgbImage picture(std::size_t view) const;
};

[[nodiscard]] inline Camera sceneCamera() {
  return {340, 256, 431, 430, 171.2, 126.6, 0.142, 0.655, 0.0021, -0.0013};
}

// Slow waves, fine waves and a few sharp edges: texture in every band.
[[nodiscard]] inline std::array<double, 3> seafloorPaint(double north, double east) {
  const double slow = 30 * std::sin(2.1 * north) * std::cos(1.7 * east);
  const double fine = 18 * std::sin(90 * north + 30 * std::sin(3 * east)) * std::cos(70 * east);
  const double edge = std::fmod(std::floor(north * 7) + std::floor(east * 5) + 100, 3) == 0 ? 35 : 0;
  return {100 + slow + fine + edge, 110 + 0.6 * slow + fine, 90 - slow + 0.5 * fine + edge};
}

inline void SyntheticSeafloor::addView(double north, double east, double yaw, double roll, double gain) {
  const SE3 pose = SE3::fromEuler(roll, 0, yaw, {north, east, 0});
  const double reach = 1.5 * depth * std::max(camera.width / camera.fx, camera.height / camera.fy) / 2;
  views.push_back({static_cast<std::uint32_t>(views.size()),
                   pose,
                   {north - reach, east - reach, north + reach, east + reach}});
  gains.push_back(gain);
}

inline RgbImage SyntheticSeafloor::picture(std::size_t view) const {
  RgbImage out{camera.width, camera.height, {}};
  out.rgb.resize(3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  const SE3& pose = views[view].T_nav_cam;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      std::array<double, 3> sum{};
      for (const double dv : {-0.25, 0.25}) {
        for (const double du : {-0.25, 0.25}) {
          const Eigen::Vector3d ray = pose.matrix3() * camera.ray({x + du, y + dv});
          const auto hit = [&](double at) -> Eigen::Vector3d {
            return pose.translation() + ray * (at - pose.translation().z()) / ray.z();
          };
          std::array<double, 3> colour{};
          const Eigen::Vector3d floor = hit(depth);
          colour = paint(floor.x(), floor.y());
          for (const Plate& plate : plates) {
            const Eigen::Vector3d p = hit(plate.depth);
            if (p.x() >= plate.box[0] && p.y() >= plate.box[1] && p.x() < plate.box[2] &&
                p.y() < plate.box[3])
              colour = plate.colour;
          }
          for (std::size_t c = 0; c < 3; ++c) sum[c] += colour[c] / 4;
        }
      }
      for (std::size_t c = 0; c < 3; ++c)
        out.at(x, y)[c] = static_cast<std::uint8_t>(std::clamp(std::lround(gains[view] * sum[c]), 0L, 255L));
    }
  }
  return out;
}

inline void SyntheticSeafloor::take() {
  pictures.clear();
  for (std::size_t view = 0; view < views.size(); ++view) pictures.push_back(picture(view));
}

// A flat square tile of the scene's seafloor, [low, high) north and east, `edge` [m] a face.
[[nodiscard]] inline TileMesh flatTile(double low, double high, double depth, double edge) {
  TileMesh tile;
  const auto n = static_cast<int>(std::lround((high - low) / edge));
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
      tile.mesh.vertices.push_back(Eigen::Vector3d(TileGrid::snap(low + i * edge),
                                                   TileGrid::snap(low + j * edge), TileGrid::snap(depth))
                                       .cast<float>());
  tile.mesh.triangles = test::latticeTriangles(n + 1, n + 1);
  computeNormals(tile.mesh);
  tile.shared.assign(tile.mesh.vertices.size(), 0);
  return tile;
}

[[nodiscard]] inline Mesh plateMesh(const SyntheticSeafloor::Plate& plate) {
  Mesh mesh;
  for (const std::size_t n : {0, 2})
    for (const std::size_t e : {1, 3})
      mesh.vertices.push_back(Eigen::Vector3d(plate.box[n], plate.box[e], plate.depth).cast<float>());
  mesh.triangles = {{0, 1, 3}, {0, 3, 2}};
  return mesh;
}

}  // namespace fathom::surface
