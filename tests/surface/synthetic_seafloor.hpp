#pragma once

#include <array>
#include <functional>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/tile_mesh.hpp"
#include "recon/surface/view_index.hpp"

namespace fathom::surface {

// A synthetic painted seafloor, flat at `depth`, with level plates above it, seen by cameras that look down.
struct SyntheticSeafloor {
  struct Plate {
    std::array<double, 4> box{};  // north, east low, then high [m]
    double depth = 0;             // [m]
    std::array<double, 3> colour{};
  };
  using Paint = std::function<std::array<double, 3>(double north, double east)>;

  Camera camera;
  Paint paint;
  double depth = 2;
  std::vector<Plate> plates;  // no two above each other
  std::vector<View> views;
  std::vector<double> gains;       // of a view's picture; 1 where absent
  std::vector<RgbImage> pictures;  // one a view, by take()

  // A view from a place at depth 0, turned by `yaw` and tilted by `roll` [rad].
  void addView(double north, double east, double yaw = 0, double roll = 0, double gain = 1);
  // Draws every view's picture, 2 x 2 samples a pixel. `only`: this view alone.
  void take();
  [[nodiscard]] RgbImage picture(std::size_t view) const;
};

// Slow waves, fine waves and a few sharp edges: texture in every band.
[[nodiscard]] std::array<double, 3> seafloorPaint(double north, double east);

// A flat square tile of the scene's seafloor, [low, high) north and east, `edge` [m] a face.
[[nodiscard]] TileMesh flatTile(double low, double high, double depth, double edge);
[[nodiscard]] Mesh plateMesh(const SyntheticSeafloor::Plate& plate);
[[nodiscard]] Camera sceneCamera();

}  // namespace fathom::surface
