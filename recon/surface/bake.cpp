#include "recon/surface/bake.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <map>

#include "recon/surface/chart_face.hpp"
#include "recon/surface/simplify.hpp"

namespace fathom::surface {
namespace {

std::size_t pixelIndex(const ColourGrid& grid, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) + static_cast<std::size_t>(x);
}

ColourGrid halved(const ColourGrid& fine) {
  ColourGrid out{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
  const std::size_t places = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.values.assign(4 * places, 0.0F);
  out.known.assign(places, 0);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const std::size_t to = pixelIndex(out, x, y);
      float count = 0;
      for (int v = 2 * y; v < std::min(2 * y + 2, fine.height); ++v) {
        for (int u = 2 * x; u < std::min(2 * x + 2, fine.width); ++u) {
          const std::size_t from = pixelIndex(fine, u, v);
          if (fine.known[from] == 0) continue;
          ++count;
          for (std::size_t c = 0; c < 4; ++c) out.values[4 * to + c] += fine.values[4 * from + c];
        }
      }
      if (count == 0) continue;
      out.known[to] = 1;
      for (std::size_t c = 0; c < 4; ++c) out.values[4 * to + c] /= count;
    }
  }
  return out;
}

// Between the four coarse places around the middle of a fine one.
void pushTo(ColourGrid& fine, const ColourGrid& coarse) {
  for (int y = 0; y < fine.height; ++y) {
    for (int x = 0; x < fine.width; ++x) {
      const std::size_t to = pixelIndex(fine, x, y);
      if (fine.known[to] != 0) continue;
      const int x0 = std::max(0, (x - 1) / 2), x1 = std::min((x + 1) / 2, coarse.width - 1);
      const int y0 = std::max(0, (y - 1) / 2), y1 = std::min((y + 1) / 2, coarse.height - 1);
      const float fx = x % 2 == 0 ? 0.75F : 0.25F, fy = y % 2 == 0 ? 0.75F : 0.25F;
      for (std::size_t c = 0; c < 4; ++c) {
        const auto value = [&](int u, int v) { return coarse.values[4 * pixelIndex(coarse, u, v) + c]; };
        const float top = value(x0, y0) + fx * (value(x1, y0) - value(x0, y0));
        const float bottom = value(x0, y1) + fx * (value(x1, y1) - value(x0, y1));
        fine.values[4 * to + c] = top + fy * (bottom - top);
      }
    }
  }
}

// Rows processed at a time: bounds the memory beside the image to some 2 MB.
constexpr int kBandRows = 64;
// Greatest distance of a child's surface from the parent's texel that it colours: the difference of the
// levels, obliquely, and some texels.
constexpr double kReachErrors = 5, kReachTexels = 16;
constexpr int kMostSamplesOfTexel = 8;  // along one edge of a texel

// A child's triangle over a chart of the parent, with its place in the child's texture.
struct Source {
  const RgbImage* image;
  // Place in the child's atlas [texels, centres at half steps] of column 0, row 0, and its change with both.
  Eigen::Vector2d base, for_column, for_row;
};

std::array<float, 3> bilinear(const RgbImage& image, double column, double row) {
  const double x = std::clamp(column - 0.5, 0.0, image.width - 1.0);
  const double y = std::clamp(row - 0.5, 0.0, image.height - 1.0);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
  const auto u = static_cast<float>(x - x0), v = static_cast<float>(y - y0);
  const std::uint8_t *a = image.at(x0, y0), *b = image.at(x1, y0), *c = image.at(x0, y1),
                     *d = image.at(x1, y1);
  std::array<float, 3> out;
  for (std::size_t k = 0; k < 3; ++k)
    out[k] = (1 - v) * ((1 - u) * static_cast<float>(a[k]) + u * static_cast<float>(b[k])) +
             v * ((1 - u) * static_cast<float>(c[k]) + u * static_cast<float>(d[k]));
  return out;
}

class Bake {
 public:
  Bake(const Atlas& parent, const std::vector<const TexturedTile*>& children)
      : parent_(parent), children_(children) {
    image_ = {parent.width, parent.height, {}};
    image_.rgb.assign(3 * static_cast<std::size_t>(parent.width) * static_cast<std::size_t>(parent.height),
                      0);
    known_.assign(image_.rgb.size() / 3, 0);
    reach_ = static_cast<float>(kReachErrors * parent.tile.surface.error + kReachTexels * parent.tile.texel);
  }

  RgbImage run() {
    for (int row = 0; row < parent_.height; row += kBandRows)
      band(row, std::min(kBandRows, parent_.height - row));
    fillUnknown(image_, known_);
    return std::move(image_);
  }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;
  struct Nearest {
    float distance;  // along the chart's axis [m]
    std::uint32_t source;
  };

  void band(int first, int rows) {
    rasterise(parent_, first, rows, texels_);
    nearest_.assign(texels_.size(), {reach_, kNone});
    sources_.clear();
    for (const Chart& chart : parent_.charts) {
      if (chart.y >= first + rows || chart.y + chart.height <= first) continue;
      for (const TexturedTile* child : children_)
        if (!child->atlas.empty())
          for (std::uint32_t f = 0; f < child->surface.mesh.triangles.size(); ++f)
            draw(chart, *child, f, first, rows);
    }
    for (std::size_t i = 0; i < texels_.size(); ++i) {
      if (nearest_[i].source == kNone) continue;
      const int column = static_cast<int>(i) % parent_.width,
                row = first + static_cast<int>(i) / parent_.width;
      sample(sources_[nearest_[i].source], column, row);
    }
  }

  void draw(const Chart& chart, const TexturedTile& child, std::uint32_t f, int first, int rows) {
    const Mesh& mesh = child.surface.mesh;
    const ChartFace face(chart, mesh, f);
    const int top = std::max(first, chart.y), bottom = std::min(first + rows, chart.y + chart.height);
    if (face.facing() <= 0 || face.bottom() < top || face.top() > bottom || face.right() < chart.x ||
        face.left() > chart.x + chart.width)
      return;
    const auto number = static_cast<std::uint32_t>(sources_.size());
    bool used = false;
    forTriangleRows(face.corners(), mesh.triangles[f], top, bottom, [&](int y, int begin, int end) {
      const std::size_t base = static_cast<std::size_t>(y - first) * static_cast<std::size_t>(parent_.width);
      for (int x = std::max(begin, chart.x); x < std::min(end, chart.x + chart.width); ++x) {
        const std::size_t at = base + static_cast<std::size_t>(x);
        if (texels_[at].face < 0) continue;
        const double wanted = (texels_[at].point.cast<double>() - chart.origin).dot(chart.along);
        const auto distance = static_cast<float>(std::abs(face.height(x + 0.5, y + 0.5) - wanted));
        if (distance >= nearest_[at].distance) continue;
        nearest_[at] = {distance, number};
        used = true;
      }
    });
    if (used) sources_.push_back(sourceOf(face, child, f));
  }

  static Source sourceOf(const ChartFace& face, const TexturedTile& child, std::uint32_t f) {
    const auto place = [&](std::size_t k) {
      const Eigen::Vector2d st =
          child.surface.mesh.texture_coordinates[child.surface.mesh.triangles[f][k]].cast<double>();
      return Eigen::Vector2d(st.x() * child.atlas.width, (1 - st.y()) * child.atlas.height);
    };
    const auto& corner = face.corners();
    const Eigen::Vector2d u = corner[1] - corner[0], v = corner[2] - corner[0];
    const Eigen::Vector2d origin = place(0), du = place(1) - origin, dv = place(2) - origin;
    const double twice_area = u.x() * v.y() - u.y() * v.x();
    Source source{
        &child.atlas, {}, (du * v.y() - dv * u.y()) / twice_area, (dv * u.x() - du * v.x()) / twice_area};
    source.base = origin - source.for_column * corner[0].x() - source.for_row * corner[0].y();
    return source;
  }

  // The mean over the texel's area: as many samples as it covers texels of the child.
  void sample(const Source& source, int column, int row) {
    const auto count = [](const Eigen::Vector2d& step) {
      return std::clamp(static_cast<int>(std::lround(step.norm())), 1, kMostSamplesOfTexel);
    };
    const int columns = count(source.for_column), rows = count(source.for_row);
    std::array<float, 3> sum{};
    for (int v = 0; v < rows; ++v)
      for (int u = 0; u < columns; ++u) {
        const Eigen::Vector2d at = source.base + source.for_column * (column + (u + 0.5) / columns) +
                                   source.for_row * (row + (v + 0.5) / rows);
        const std::array<float, 3> rgb = bilinear(*source.image, at.x(), at.y());
        for (std::size_t k = 0; k < 3; ++k) sum[k] += rgb[k];
      }
    std::uint8_t* out = image_.at(column, row);
    for (std::size_t k = 0; k < 3; ++k)
      out[k] = static_cast<std::uint8_t>(sum[k] / static_cast<float>(columns * rows) + 0.5F);
    known_[static_cast<std::size_t>(row) * static_cast<std::size_t>(parent_.width) +
           static_cast<std::size_t>(column)] = 1;
  }

  const Atlas& parent_;
  const std::vector<const TexturedTile*>& children_;
  RgbImage image_;
  std::vector<std::uint8_t> known_;
  float reach_;
  std::vector<Texel> texels_;
  std::vector<Nearest> nearest_;
  std::vector<Source> sources_;
};

constexpr int kQuarter = 4;

constexpr int kMostSamplesOfEdge = 16;  // along the longest edge of a face
constexpr float kCornerShare = 0.5F;    // barycentric weight above which a place belongs to a corner

struct Mean {
  std::array<float, 3> sum{};
  float count = 0;
};

}  // namespace

void fillUnknown(RgbImage& image, const std::vector<std::uint8_t>& known) {
  const auto width = static_cast<std::size_t>(image.width), height = static_cast<std::size_t>(image.height);
  assert(known.size() == width * height);
  if (std::find(known.begin(), known.end(), 0) == known.end() ||
      std::find(known.begin(), known.end(), 1) == known.end())
    return;
  // Half the size: the mean of the known among four.
  const std::size_t half_width = (width + 1) / 2, half_height = (height + 1) / 2;
  RgbImage half{static_cast<int>(half_width), static_cast<int>(half_height), {}};
  half.rgb.assign(3 * half_width * half_height, 0);
  std::vector<std::uint8_t> half_known(half_width * half_height, 0);
  for (std::size_t y = 0; y < half_height; ++y)
    for (std::size_t x = 0; x < half_width; ++x) {
      unsigned count = 0, sum[3] = {0, 0, 0};
      for (std::size_t v = 2 * y; v < std::min(height, 2 * y + 2); ++v)
        for (std::size_t u = 2 * x; u < std::min(width, 2 * x + 2); ++u) {
          if (known[v * width + u] == 0) continue;
          ++count;
          for (std::size_t c = 0; c < 3; ++c) sum[c] += image.rgb[3 * (v * width + u) + c];
        }
      if (count == 0) continue;
      half_known[y * half_width + x] = 1;
      for (std::size_t c = 0; c < 3; ++c)
        half.rgb[3 * (y * half_width + x) + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    }
  fillUnknown(half, half_known);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      if (known[y * width + x] == 0)
        for (std::size_t c = 0; c < 3; ++c)
          image.rgb[3 * (y * width + x) + c] = half.rgb[3 * (y / 2 * half_width + x / 2) + c];
}

bool fillSmoothly(ColourGrid& grid) {
  const auto unknown = std::count(grid.known.begin(), grid.known.end(), std::uint8_t{0});
  if (unknown == 0) return true;
  if (unknown == static_cast<std::ptrdiff_t>(grid.known.size())) return false;
  ColourGrid coarse = halved(grid);
  fillSmoothly(coarse);
  pushTo(grid, coarse);
  std::fill(grid.known.begin(), grid.known.end(), std::uint8_t{1});
  return true;
}

RgbImage bakeFromChildren(const Atlas& parent, const std::vector<const TexturedTile*>& children) {
  return Bake(parent, children).run();
}

TexturedTile quarterAtlas(const TexturedTile& tile) {
  const RgbImage& fine = tile.atlas;
  assert(fine.width % kQuarter == 0 && fine.height % kQuarter == 0);
  TexturedTile out{tile.surface, {fine.width / kQuarter, fine.height / kQuarter, {}}, tile.texel * kQuarter};
  out.atlas.rgb.resize(3 * static_cast<std::size_t>(out.atlas.width) *
                       static_cast<std::size_t>(out.atlas.height));
  for (int y = 0; y < out.atlas.height; ++y) {
    for (int x = 0; x < out.atlas.width; ++x) {
      std::array<unsigned, 3> sum{};
      for (int v = 0; v < kQuarter; ++v) {
        const std::uint8_t* row = fine.at(kQuarter * x, kQuarter * y + v);
        for (std::size_t u = 0; u < kQuarter; ++u)
          for (std::size_t c = 0; c < 3; ++c) sum[c] += row[3 * u + c];
      }
      constexpr unsigned kTexels = kQuarter * kQuarter;
      for (std::size_t c = 0; c < 3; ++c)
        out.atlas.at(x, y)[c] = static_cast<std::uint8_t>((sum[c] + kTexels / 2) / kTexels);
    }
  }
  return out;
}

void colourVertices(TexturedTile& tile) {
  Mesh& mesh = tile.surface.mesh;
  const RgbImage& atlas = tile.atlas;
  std::map<std::array<std::uint32_t, 3>, Mean> means;
  for (const auto& t : mesh.triangles) {
    std::array<Mean*, 3> corner;
    std::array<Eigen::Vector2f, 3> texel;
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = &means[bitsOf(mesh.vertices[t[k]])];
      const Eigen::Vector2f& st = mesh.texture_coordinates[t[k]];
      texel[k] = {st.x() * static_cast<float>(atlas.width), (1 - st.y()) * static_cast<float>(atlas.height)};
    }
    const float longest =
        std::max({(texel[0] - texel[1]).norm(), (texel[1] - texel[2]).norm(), (texel[2] - texel[0]).norm()});
    const int n = std::clamp(static_cast<int>(std::ceil(longest)), 2, kMostSamplesOfEdge);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n - i; ++j) {
        const auto whole = static_cast<float>(n);
        const float a = (static_cast<float>(i) + 1.0F / 3) / whole,
                    b = (static_cast<float>(j) + 1.0F / 3) / whole;
        const std::array<float, 3> share{1 - a - b, a, b};
        const auto most =
            static_cast<std::size_t>(std::max_element(share.begin(), share.end()) - share.begin());
        if (share[most] < kCornerShare) continue;
        const Eigen::Vector2f at = share[0] * texel[0] + a * texel[1] + b * texel[2];
        const std::uint8_t* colour = atlas.at(std::clamp(static_cast<int>(at.x()), 0, atlas.width - 1),
                                              std::clamp(static_cast<int>(at.y()), 0, atlas.height - 1));
        for (std::size_t c = 0; c < 3; ++c) corner[most]->sum[c] += static_cast<float>(colour[c]);
        corner[most]->count += 1;
      }
  }
  mesh.colours.resize(mesh.vertices.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto found = means.find(bitsOf(mesh.vertices[v]));
    if (found == means.end() || found->second.count == 0) continue;
    for (std::size_t c = 0; c < 3; ++c)
      mesh.colours[v][c] = static_cast<std::uint8_t>(std::lround(found->second.sum[c] / found->second.count));
  }
}

}  // namespace fathom::surface
