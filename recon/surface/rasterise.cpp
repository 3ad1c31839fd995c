#include <algorithm>
#include <array>
#include <limits>

#include "recon/surface/atlas.hpp"
#include "recon/surface/chart_face.hpp"
#include "recon/surface/triangle_rows.hpp"

namespace fathom::surface {
namespace {

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
    const Eigen::Vector2d way = b - a;
    const double length2 = std::max(way.squaredNorm(), std::numeric_limits<double>::min());
    for (int y = top; y < bottom; ++y)
      for (int x = left; x < right; ++x) {
        Texel& texel = row(y)[x];
        float& nearest = distance_[static_cast<std::size_t>(&texel - texels_.data())];
        if (texel.face >= 0 && nearest == std::numeric_limits<float>::max()) continue;  // a face's own
        const Eigen::Vector2d at(x + 0.5, y + 0.5);
        const Eigen::Vector2d on = a + way * std::clamp((at - a).dot(way) / length2, 0.0, 1.0);
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

void rasterise(const Atlas& atlas, int first_row, int rows, std::vector<Texel>& texels) {
  Drawing(atlas, first_row, rows, texels).run();
}

}  // namespace fathom::surface
