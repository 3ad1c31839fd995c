#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "realtime/kernel/input_error.hpp"
#include "recon/compare/surface_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/triangle_scan.hpp"

namespace fathom::compare {
namespace {

class MeshSurface final : public SurfaceFile {
 public:
  MeshSurface(const std::filesystem::path& path, const std::string& crs, const FrameBeside& beside)
      : mesh_(readPly(path)) {
    if (!crs.empty())
      frame_ = frameFrom(crs, path.string());
    else if (beside)
      frame_ = beside(path);
    if (mesh_.empty()) throw InputError(path.string(), "", "has no triangles: no surface to compare");
    about_ = "mesh of " + std::to_string(mesh_.triangles.size()) + " triangles";
  }

  PlaneFrame frame() const override { return frame_; }

  Box bounds(const PlaneFrame& to) const override {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Box box{kFar, kFar, -kFar, -kFar};
    for (const Eigen::Vector3f& v : mesh_.vertices) {
      const double east = static_cast<double>(v.y()), north = static_cast<double>(v.x());
      box = {std::min(box.west, east), std::min(box.south, north), std::max(box.east, east),
             std::max(box.north, north)};
    }
    return PlaneTransform(frame_, to).apply(box);
  }

  double spacing(const PlaneFrame&) const override {
    double sum = 0;
    for (const auto& t : mesh_.triangles)
      for (std::size_t k = 0; k < 3; ++k)
        sum += static_cast<double>((mesh_.vertices[t[k]] - mesh_.vertices[t[(k + 1) % 3]]).head<2>().norm());
    return std::max(sum / (3.0 * static_cast<double>(mesh_.triangles.size())), 1e-3);
  }

  HeightMap read(const PlaneFrame& to, const Box& box, double cell) const override {
    // Read out at about the triangles' own size, then averaged: a cell's middle alone would alias.
    const int finer = std::clamp(static_cast<int>(std::ceil(cell / spacing(to))), 1, 64);
    HeightMap coarse(box, cell);
    HeightMap fine = coarse;
    fine.cell = cell / finer;
    fine.columns *= finer;
    fine.rows *= finer;
    const std::size_t size = static_cast<std::size_t>(fine.columns) * static_cast<std::size_t>(fine.rows);
    fine.up.assign(size, std::numeric_limits<float>::quiet_NaN());
    if (!mesh_.sigma.empty()) fine.sigma = fine.up;

    std::vector<double> east, north;
    for (const Eigen::Vector3f& v : mesh_.vertices) {
      east.push_back(static_cast<double>(v.y()));
      north.push_back(static_cast<double>(v.x()));
    }
    PlaneTransform(frame_, to).apply(east, north);
    for (const auto& t : mesh_.triangles) draw(t, east, north, fine);
    return fine.coarser(finer);
  }

 private:
  // The upper surface at each cell's middle.
  void draw(const std::array<std::uint32_t, 3>& t, const std::vector<double>& east,
            const std::vector<double>& north, HeightMap& map) const {
    std::array<Eigen::Vector2d, 3> p;  // (row, column)
    for (std::size_t k = 0; k < 3; ++k) {
      p[k] = {(map.north - north[t[k]]) / map.cell - 0.5, (east[t[k]] - map.west) / map.cell - 0.5};
      if (!p[k].allFinite()) return;
    }
    scanTriangle(p, map.rows, map.columns, [&](int row, int column, const std::array<double, 3>& shares) {
      const auto between = [&](auto&& value) {
        double sum = 0;
        for (std::size_t k = 0; k < 3; ++k) sum += shares[k] * static_cast<double>(value(t[k]));
        return static_cast<float>(sum);
      };
      const float up = between([&](std::uint32_t v) { return -mesh_.vertices[v].z(); });
      const std::size_t at = map.index(column, row);
      if (map.up[at] >= up) return;
      map.up[at] = up;
      if (!mesh_.sigma.empty()) map.sigma[at] = between([&](std::uint32_t v) { return mesh_.sigma[v]; });
    });
  }

  Mesh mesh_;
  PlaneFrame frame_;
};

}  // namespace

std::unique_ptr<SurfaceFile> openMesh(const std::filesystem::path& path, const std::string& crs,
                                      const FrameBeside& beside) {
  return std::make_unique<MeshSurface>(path, crs, beside);
}

}  // namespace fathom::compare
