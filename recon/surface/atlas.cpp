#include "recon/surface/atlas.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "recon/geometry/triangle_edges.hpp"
#include "recon/surface/charts.hpp"
#include "recon/surface/packing.hpp"

namespace fathom::surface {
namespace {

// Blocks of BC1 and quarters of an atlas never lie in two charts, and a parent's texel is 4 x 4 of its
// children's wherever both look from above.
constexpr int kBlock = 4;
// An atlas that came out too large is made again with texels larger by this.
constexpr double kCoarser = 1.25;

int downToBlock(double texels) {
  return kBlock * static_cast<int>(std::floor(texels / kBlock));
}
int upToBlock(double texels) {
  return kBlock * static_cast<int>(std::ceil(texels / kBlock));
}

Chart placeChart(const Mesh& mesh, const ChartFaces& faces, double texel, int gutter) {
  const ChartFrame frame = frameOf(faces.outwards);
  Eigen::Array2d low = Eigen::Array2d::Constant(std::numeric_limits<double>::max()), high = -low;
  for (const std::uint32_t f : faces.faces)
    for (const std::uint32_t v : mesh.triangles[f]) {
      const Eigen::Vector3d p = mesh.vertices[v].cast<double>();
      const Eigen::Array2d at(p.dot(frame.right) / texel, p.dot(frame.down) / texel);
      low = low.min(at);
      high = high.max(at);
    }
  const int left = downToBlock(low.x() - gutter), top = downToBlock(low.y() - gutter);
  Chart chart;
  chart.width = upToBlock(high.x() + gutter) - left;
  chart.height = upToBlock(high.y() + gutter) - top;
  chart.right = texel * frame.right;
  chart.down = texel * frame.down;
  chart.along = -faces.outwards;
  chart.origin = (left + 0.5) * chart.right + (top + 0.5) * chart.down;
  return chart;
}

// The surface with one vertex for each vertex and chart, and the places of the vertices in the atlas.
void fillTile(const TileMesh& surface, const std::vector<ChartFaces>& faces, Atlas& atlas) {
  const Mesh& from = surface.mesh;
  TileMesh& to = atlas.tile.surface;
  to.tile = surface.tile;
  to.error = surface.error;
  to.mesh.triangles.resize(from.triangles.size());
  atlas.chart_of_face.resize(from.triangles.size());
  constexpr std::uint32_t kNone = 0xFFFFFFFF;
  std::vector<std::uint32_t> number(from.vertices.size()), seen_by(from.vertices.size(), kNone);
  for (std::uint32_t c = 0; c < faces.size(); ++c) {
    const Chart& chart = atlas.charts[c];
    const double texel2 = chart.right.squaredNorm();
    for (const std::uint32_t f : faces[c].faces) {
      atlas.chart_of_face[f] = static_cast<std::uint16_t>(c);
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = from.triangles[f][k];
        if (seen_by[v] != c) {
          seen_by[v] = c;
          number[v] = static_cast<std::uint32_t>(to.mesh.vertices.size());
          to.mesh.vertices.push_back(from.vertices[v]);
          if (!from.normals.empty()) to.mesh.normals.push_back(from.normals[v]);
          if (!from.colours.empty()) to.mesh.colours.push_back(from.colours[v]);
          if (!from.sigma.empty()) to.mesh.sigma.push_back(from.sigma[v]);
          if (!surface.views.empty()) to.views.push_back(surface.views[v]);
          to.shared.push_back(surface.shared.empty() ? std::uint8_t{0} : surface.shared[v]);
          const Eigen::Vector3d p = from.vertices[v].cast<double>() - chart.origin;
          const double column = chart.x + p.dot(chart.right) / texel2 + 0.5;
          const double row = chart.y + p.dot(chart.down) / texel2 + 0.5;
          to.mesh.texture_coordinates.emplace_back(static_cast<float>(column / atlas.width),
                                                   static_cast<float>(1 - row / atlas.height));
        }
        to.mesh.triangles[f][k] = number[v];
      }
    }
  }
}

std::vector<Rim> rimsOf(const Mesh& mesh) {
  // Vertices of the atlas belong to one chart, so that a side with another face is found by its vertices
  // alone.
  std::vector<Rim> rims;
  visitEdges(mesh.triangles, [&](const std::vector<std::uint32_t>& sides) {
    if (sides.size() == 1) rims.push_back({sides[0] / 3, sides[0] % 3});
  });
  return rims;
}

}  // namespace

Atlas makeAtlas(const TileMesh& surface, const AtlasConfig& config) {
  assert(config.texel > 0 && config.max_edge >= 64 && config.gutter >= 1);
  Atlas atlas;
  atlas.gutter = config.gutter;
  atlas.tile.texel = config.texel;
  std::vector<ChartFaces> faces;
  for (;; atlas.tile.texel *= kCoarser) {
    faces = makeCharts(surface.mesh, atlas.tile.texel);
    atlas.charts.clear();
    std::vector<Rectangle> rectangles;
    for (const ChartFaces& chart : faces) {
      atlas.charts.push_back(placeChart(surface.mesh, chart, atlas.tile.texel, config.gutter));
      rectangles.push_back({atlas.charts.back().width, atlas.charts.back().height});
    }
    const PackedSize size = pack(rectangles);
    atlas.width = size.width;
    atlas.height = size.height;
    for (std::size_t c = 0; c < rectangles.size(); ++c) {
      atlas.charts[c].x = rectangles[c].x;
      atlas.charts[c].y = rectangles[c].y;
    }
    if (std::max(atlas.width, atlas.height) <= config.max_edge) break;
  }
  fillTile(surface, faces, atlas);
  atlas.rims = rimsOf(atlas.tile.surface.mesh);
  return atlas;
}

}  // namespace fathom::surface
