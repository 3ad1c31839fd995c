#include "recon/surface/chart_lattice.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::surface {
namespace {

constexpr int kStripRows = 64;  // of the atlas, rasterised at a time

// A texel of a cell that shows a face, with the plane there.
struct Sample {
  std::int32_t face = -1;
  std::int32_t x = 0, y = 0;  // in the chart [texels]
  Eigen::Vector3f point;
};

Eigen::Vector3d middleOf(const Mesh& mesh) {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = low;
  bool first = true;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    const Eigen::Vector3d p = v.cast<double>();
    low = first ? p : low.cwiseMin(p).eval();
    high = first ? p : high.cwiseMax(p).eval();
    first = false;
  }
  // A whole number, so that subtracting it from single precision is exact.
  return ((low + high) / 2).array().round();
}

std::vector<Eigen::Vector3f> faceNormals(const Mesh& mesh) {
  std::vector<Eigen::Vector3f> normals;
  normals.reserve(mesh.triangles.size());
  for (const auto& t : mesh.triangles) {
    const Eigen::Vector3f& a = mesh.vertices[t[0]];
    const Eigen::Vector3f n = (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a);
    const float length = n.norm();
    normals.emplace_back(length > 0 ? Eigen::Vector3f(n / length) : Eigen::Vector3f::Zero());
  }
  return normals;
}

class Filler {
 public:
  Filler(const Atlas& atlas, ChartLattice& lattice)
      : atlas_(atlas),
        lattice_(lattice),
        normals_(faceNormals(atlas.tile.surface.mesh)),
        samples_(lattice.covered.size()) {}

  void readStrips() {
    std::vector<Texel> texels;
    for (int first = 0; first < atlas_.height; first += kStripRows) {
      const int rows = std::min(kStripRows, atlas_.height - first);
      rasterise(atlas_, first, rows, texels);
      for (std::size_t c = 0; c < atlas_.charts.size(); ++c) readChart(c, first, rows, texels);
    }
  }

  // Nodes of covered cells without a face are on the plane of the nearest texel around that shows one.
  void extend() {
    for (std::size_t c = 0; c < atlas_.charts.size(); ++c) {
      const ChartLattice::Grid& grid = lattice_.grids[c];
      for (int j = 0; j < grid.rows; ++j)
        for (int i = 0; i < grid.columns; ++i)
          if (!lattice_.known[grid.node(i, j)]) extendTo(c, i, j);
    }
  }

 private:
  void readChart(std::size_t c, int first, int rows, const std::vector<Texel>& texels) {
    const Chart& chart = atlas_.charts[c];
    const ChartLattice::Grid& grid = lattice_.grids[c];
    const int y0 = std::max(chart.y, first), y1 = std::min(chart.y + chart.height, first + rows);
    for (int y = y0; y < y1; ++y) {
      const Texel* row =
          &texels[static_cast<std::size_t>(y - first) * static_cast<std::size_t>(atlas_.width) +
                  static_cast<std::size_t>(chart.x)];
      const int cy = y - chart.y, j = cy / kTexelStep;
      for (int cx = 0; cx < chart.width; ++cx) {
        const Texel& texel = row[cx];
        if (texel.face < 0) continue;
        const int i = cx / kTexelStep;
        const std::size_t cell = grid.cell(i, j);
        ++lattice_.texels;
        if (lattice_.covered[cell]++ == 0) samples_[cell] = {texel.face, cx, cy, texel.point};
        if (cx % kTexelStep == 0 && cy % kTexelStep == 0) set(grid.node(i, j), texel.point, texel.face);
      }
    }
  }

  void set(std::size_t node, const Eigen::Vector3f& point, std::int32_t face) {
    const Eigen::Vector3f p = point - lattice_.origin.cast<float>();
    const Eigen::Vector3f& n = normals_[static_cast<std::size_t>(face)];
    lattice_.known[node] = 1;
    lattice_.x[node] = p.x(), lattice_.y[node] = p.y(), lattice_.z[node] = p.z();
    lattice_.nx[node] = n.x(), lattice_.ny[node] = n.y(), lattice_.nz[node] = n.z();
  }

  void extendTo(std::size_t c, int i, int j) {
    const Chart& chart = atlas_.charts[c];
    const ChartLattice::Grid& grid = lattice_.grids[c];
    const Sample* nearest = nullptr;
    int best = 0;
    for (const int v : {j - 1, j}) {
      for (const int u : {i - 1, i}) {
        if (u < 0 || v < 0 || u >= grid.columns - 1 || v >= grid.rows - 1) continue;
        const std::size_t cell = grid.cell(u, v);
        if (lattice_.covered[cell] == 0) continue;
        const Sample& sample = samples_[cell];
        const int dx = kTexelStep * i - sample.x, dy = kTexelStep * j - sample.y,
                  distance = dx * dx + dy * dy;
        if (nearest == nullptr || distance < best) nearest = &sample, best = distance;
      }
    }
    if (nearest == nullptr) return;
    const Eigen::Vector3d normal = normals_[static_cast<std::size_t>(nearest->face)].cast<double>();
    const Eigen::Vector3d step =
        (kTexelStep * i - nearest->x) * chart.right + (kTexelStep * j - nearest->y) * chart.down;
    const double facing = normal.dot(chart.along);
    constexpr double kEdgeOn = 0.05;  // faces of a chart look along it; less than this is degenerate
    const double shift = std::abs(facing) > kEdgeOn ? -normal.dot(step) / facing : 0;
    const Eigen::Vector3d moved = nearest->point.cast<double>() + step + shift * chart.along;
    set(grid.node(i, j), moved.cast<float>(), nearest->face);
  }

  const Atlas& atlas_;
  ChartLattice& lattice_;
  std::vector<Eigen::Vector3f> normals_;
  std::vector<Sample> samples_;
};

}  // namespace

ChartLattice::ChartLattice(const Atlas& atlas) : origin(middleOf(atlas.tile.surface.mesh)) {
  std::size_t nodes = 0, cells = 0;
  for (const Chart& chart : atlas.charts) {
    Grid grid{(chart.width + kTexelStep - 1) / kTexelStep + 1,
              (chart.height + kTexelStep - 1) / kTexelStep + 1, nodes, cells};
    grids.push_back(grid);
    nodes += static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
    cells += static_cast<std::size_t>(grid.columns - 1) * static_cast<std::size_t>(grid.rows - 1);
  }
  for (auto* values : {&x, &y, &z, &nx, &ny, &nz}) values->assign(nodes, 0.0F);
  known.assign(nodes, 0);
  covered.assign(cells, 0);
  Filler filler(atlas, *this);
  filler.readStrips();
  filler.extend();
}

}  // namespace fathom::surface
