#include "recon/surface/atlas.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>

#include "recon/geometry/mesh.hpp"
#include "recon/surface/chart_face.hpp"
#include "recon/surface/charts.hpp"

namespace fathom::surface {
namespace {

// Blocks of BC1 and quarters of an atlas are within one chart each, and a parent's texel is 4 x 4 of its
// children's where both are drawn from above.
constexpr int kBlock = 4;
// Factor by which texels are enlarged when an atlas is too large.
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
  // Vertices of the atlas belong to one chart, so that a side with another face is found by its
  // vertices alone.
  std::vector<Rim> rims;
  visitEdges(mesh.triangles, [&](const std::vector<std::uint32_t>& sides) {
    if (sides.size() == 1) rims.push_back({sides[0] / 3, sides[0] % 3});
  });
  return rims;
}

struct Rectangle {
  int width = 0, height = 0;  // [texels]
  int x = 0, y = 0;           // position in the atlas
};

struct PackedSize {
  int width = 0, height = 0;
};

struct Step {
  int x, width, top;  // of the skyline: free from `top` downwards
};

// Places all in `order`; returns their height.
int packInto(std::vector<Rectangle>& rectangles, const std::vector<std::size_t>& order, int width) {
  std::vector<Step> skyline = {{0, width, 0}};
  int height = 0;
  for (const std::size_t number : order) {
    Rectangle& r = rectangles[number];
    std::size_t best = skyline.size();
    int best_top = 0;
    for (std::size_t i = 0; i < skyline.size() && skyline[i].x + r.width <= width; ++i) {
      int top = 0;
      for (std::size_t k = i; k < skyline.size() && skyline[k].x < skyline[i].x + r.width; ++k)
        top = std::max(top, skyline[k].top);
      if (best == skyline.size() || top < best_top) {
        best = i;
        best_top = top;
      }
    }
    r.x = skyline[best].x;
    r.y = best_top;
    height = std::max(height, r.y + r.height);
    // The steps under it end where it does.
    const int right = r.x + r.width;
    std::size_t after = best;
    while (after < skyline.size() && skyline[after].x + skyline[after].width <= right) ++after;
    if (after < skyline.size() && skyline[after].x < right) {
      skyline[after].width -= right - skyline[after].x;
      skyline[after].x = right;
    }
    skyline.erase(skyline.begin() + static_cast<std::ptrdiff_t>(best),
                  skyline.begin() + static_cast<std::ptrdiff_t>(after));
    skyline.insert(skyline.begin() + static_cast<std::ptrdiff_t>(best), {r.x, r.width, r.y + r.height});
  }
  return height;
}

// Packs rectangles without overlap, on a skyline (Jylanki 2010, "bottom left"), with the width of a few that
// gives the least area. Sizes that are multiples of a number give positions that are.
PackedSize pack(std::vector<Rectangle>& rectangles) {
  if (rectangles.empty()) return {};
  std::vector<std::size_t> order(rectangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const Rectangle &p = rectangles[a], &q = rectangles[b];
    return p.height != q.height ? p.height > q.height : p.width > q.width;
  });
  int widest = 0, all = 0, narrow = 0;
  for (const Rectangle& r : rectangles) {
    widest = std::max(widest, r.width);
    all += r.width;
  }
  // Widths to try: the widest rectangle's with room for a column of narrower ones.
  for (const Rectangle& r : rectangles)
    if (r.width < widest) narrow = std::max(narrow, r.width);
  PackedSize best;
  long long best_area = 0;
  for (const int width : {widest, widest + narrow, widest + 2 * narrow, 2 * widest, 3 * widest, 4 * widest}) {
    if (width > std::max(all, widest)) continue;
    const int height = packInto(rectangles, order, width);
    // Of equal areas the one nearer to a square.
    const long long area = 1LL * width * height, longer = std::max(width, height);
    if (best.width == 0 || area < best_area ||
        (area == best_area && longer < std::max(best.width, best.height))) {
      best = {width, height};
      best_area = area;
    }
  }
  (void)packInto(rectangles, order, best.width);
  return best;
}

class Drawing {
 public:
  Drawing(const Atlas& atlas, int first_row, int rows, std::vector<Texel>& texels)
      : atlas_(atlas), first_(first_row), end_(first_row + rows), texels_(texels) {}

  void run() {
    texels_.assign(static_cast<std::size_t>(atlas_.width) * static_cast<std::size_t>(end_ - first_), Texel{});
    for (std::uint32_t f = 0; f < atlas_.chart_of_face.size(); ++f) drawFace(f);
    for (const Rim& rim : atlas_.rims) drawGutter(rim);
  }

 private:
  [[nodiscard]] Texel* row(int number) {
    return texels_.data() +
           static_cast<std::size_t>(number - first_) * static_cast<std::size_t>(atlas_.width);
  }

  void drawFace(std::uint32_t f) {
    const ChartFace face(atlas_, f);
    if (face.bottom() < first_ || face.top() > end_) return;
    forTriangleRows(face.corners(), atlas_.tile.surface.mesh.triangles[f], first_, end_,
                    [&](int y, int begin, int end) {
                      const Eigen::Vector3f start = face.point(begin + 0.5, y + 0.5).cast<float>();
                      const Eigen::Vector3f step = face.columnStep().cast<float>();
                      Texel* texel = row(y) + begin;
                      for (int k = 0; k < end - begin; ++k, ++texel) {
                        texel->face = static_cast<std::int32_t>(f);
                        texel->point = start + static_cast<float>(k) * step;
                      }
                    });
  }

  void drawGutter(const Rim& rim) {
    const ChartFace face(atlas_, rim.face);
    const Eigen::Vector2d a = face.corners()[rim.side], b = face.corners()[(rim.side + 1U) % 3];
    const double reach = atlas_.gutter;
    const int top = std::max(first_, static_cast<int>(std::min(a.y(), b.y()) - reach));
    const int bottom = std::min(end_, static_cast<int>(std::max(a.y(), b.y()) + reach) + 1);
    if (top >= bottom) return;
    const Chart& chart = atlas_.charts[atlas_.chart_of_face[rim.face]];
    const int left = std::max(chart.x, static_cast<int>(std::min(a.x(), b.x()) - reach));
    const int right = std::min(chart.x + chart.width, static_cast<int>(std::max(a.x(), b.x()) + reach) + 1);
    if (distance_.empty()) distance_.assign(texels_.size(), std::numeric_limits<float>::max());
    const Eigen::Vector2d side = b - a;
    const double length2 = std::max(side.squaredNorm(), std::numeric_limits<double>::min());
    for (int y = top; y < bottom; ++y)
      for (int x = left; x < right; ++x) {
        Texel& texel = row(y)[x];
        float& nearest = distance_[static_cast<std::size_t>(&texel - texels_.data())];
        if (texel.face >= 0 && nearest == std::numeric_limits<float>::max()) continue;  // a face's own
        const Eigen::Vector2d at(x + 0.5, y + 0.5);
        const Eigen::Vector2d on = a + side * std::clamp((at - a).dot(side) / length2, 0.0, 1.0);
        const double distance2 = (at - on).squaredNorm();
        if (distance2 > reach * reach || static_cast<float>(distance2) >= nearest) continue;
        nearest = static_cast<float>(distance2);
        texel = {static_cast<std::int32_t>(rim.face), face.beyond(on, at).cast<float>()};
      }
  }

  const Atlas& atlas_;
  int first_, end_;
  std::vector<Texel>& texels_;
  std::vector<float> distance_;  // of a gutter's texel to its rim, squared
};

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

void rasterise(const Atlas& atlas, int first_row, int rows, std::vector<Texel>& texels) {
  Drawing(atlas, first_row, rows, texels).run();
}

}  // namespace fathom::surface
