#include "recon/surface/blend.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>

#include "recon/surface/block_blender.hpp"
#include "recon/surface/chart_lattice.hpp"
#include "recon/surface/view_projection.hpp"

namespace fathom::surface {
namespace {

constexpr std::uint32_t kLeafViews = 8;

bool meet(const std::array<double, 4>& a, const std::array<double, 4>& b) {
  return a[0] <= b[2] && b[0] <= a[2] && a[1] <= b[3] && b[1] <= a[3];
}

bool usable(const std::array<double, 4>& box) {
  return std::all_of(box.begin(), box.end(), [](double v) { return std::isfinite(v); }) && box[0] <= box[2] &&
         box[1] <= box[3];
}

constexpr double kFade = 0.08;  // of the image's height: the rise of a view's weight at its border

// Mean of the vertices' colours, for a chart that no view sees.
Rgb colourOf(const Mesh& mesh) {
  std::array<double, 3> sum{};
  for (const Rgb& colour : mesh.colours)
    for (std::size_t c = 0; c < 3; ++c) sum[c] += colour[c];
  Rgb mean{};
  for (std::size_t c = 0; c < 3 && !mesh.colours.empty(); ++c)
    mean[c] = static_cast<std::uint8_t>(sum[c] / static_cast<double>(mesh.colours.size()) + 0.5);
  return mean;
}

// Paints the parts of a chart without a view: cells without a visible corner, and those without faces.
void paintRest(const Chart& chart, const ChartLattice& lattice, const ChartLattice::Grid& grid,
               const ColourGrid& filled, const std::vector<std::uint8_t>& seen, RgbImage& atlas) {
  const auto place = [&](int i, int j) {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(i);
  };
  for (int j = 0; j + 1 < grid.rows; ++j) {
    for (int i = 0; i + 1 < grid.columns; ++i) {
      const std::size_t a = place(i, j), b = a + 1, c = place(i, j + 1), d = c + 1;
      if (lattice.covered[grid.cell(i, j)] != 0 && (seen[a] | seen[b] | seen[c] | seen[d]) != 0) continue;
      for (int y = 0; y < std::min(kTexelStep, chart.height - kTexelStep * j); ++y) {
        for (int x = 0; x < std::min(kTexelStep, chart.width - kTexelStep * i); ++x) {
          const float fx = static_cast<float>(x) / kTexelStep, fy = static_cast<float>(y) / kTexelStep;
          std::uint8_t* texel = atlas.at(chart.x + kTexelStep * i + x, chart.y + kTexelStep * j + y);
          for (std::size_t k = 0; k < 3; ++k) {
            const auto at = [&](std::size_t node) { return filled.values[4 * node + k]; };
            const float top = at(a) + fx * (at(b) - at(a)), bottom = at(c) + fx * (at(d) - at(c));
            texel[k] = static_cast<std::uint8_t>(std::clamp(top + fy * (bottom - top) + 0.5F, 0.0F, 255.0F));
          }
        }
      }
    }
  }
}

constexpr int kEvery = 16;  // nodes of the lattice

// Chooses the views that are among the `most` most central ones at some place of the surface (sampled every
// 16 cm at 1.2 mm a texel), which bounds the work and the images held where the vehicle hovered or passed
// many times. Indices in `views`, ascending.
std::vector<std::uint32_t> chooseViews(const ChartLattice& lattice, const std::vector<ViewProjection>& views,
                                       int most) {
  std::vector<std::uint8_t> chosen(views.size(), 0);
  std::vector<std::pair<float, std::uint32_t>> seeing;
  const auto look = [&](std::size_t node) {
    seeing.clear();
    for (std::uint32_t i = 0; i < views.size(); ++i) {
      const ViewProjection& view = views[i];
      const auto pixel = view.project(lattice.x[node], lattice.y[node], lattice.z[node]);
      if (!pixel.valid || pixel.u < 0 || pixel.v < 0 || pixel.u > view.width - 1 || pixel.v > view.height - 1)
        continue;
      const float x = 2 * pixel.u / (view.width - 1) - 1, y = 2 * pixel.v / (view.height - 1) - 1;
      seeing.emplace_back(x * x + y * y, i);
    }
    std::sort(seeing.begin(), seeing.end());
    for (std::size_t k = 0; k < std::min(seeing.size(), static_cast<std::size_t>(std::max(most, 0))); ++k)
      chosen[seeing[k].second] = 1;
  };
  for (const ChartLattice::Grid& grid : lattice.grids) {
    for (int j = 0; j < grid.rows; j += kEvery) {
      for (int i = 0; i < grid.columns; i += kEvery) {
        // The first node with a position of this square.
        [&] {
          for (int b = j; b < std::min(j + kEvery, grid.rows); ++b)
            for (int a = i; a < std::min(i + kEvery, grid.columns); ++a)
              if (lattice.known[grid.node(a, b)] != 0) return look(grid.node(a, b));
        }();
      }
    }
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t i = 0; i < views.size(); ++i)
    if (chosen[i] != 0) out.push_back(i);
  return out;
}

}  // namespace

ViewIndex::ViewIndex(std::vector<View> views) : views_(std::move(views)) {
  for (std::uint32_t i = 0; i < views_.size(); ++i)
    if (usable(views_[i].footprint)) order_.push_back(i);
  if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
}

std::uint32_t ViewIndex::build(std::uint32_t first, std::uint32_t count) {
  const auto place = static_cast<std::uint32_t>(nodes_.size());
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Node node{{kFar, kFar, -kFar, -kFar}, first, count, 0};
  for (std::uint32_t i = first; i < first + count; ++i) {
    const auto& box = views_[order_[i]].footprint;
    for (std::size_t side = 0; side < 2; ++side) {
      node.box[side] = std::min(node.box[side], box[side]);
      node.box[side + 2] = std::max(node.box[side + 2], box[side + 2]);
    }
  }
  nodes_.push_back(node);
  if (count <= kLeafViews) return place;

  const std::size_t axis = node.box[2] - node.box[0] >= node.box[3] - node.box[1] ? 0 : 1;
  const auto middle = [&](std::uint32_t i) {
    return views_[i].footprint[axis] + views_[i].footprint[axis + 2];
  };
  const std::uint32_t half = count / 2;
  const auto begin = order_.begin() + first;
  std::nth_element(begin, begin + half, begin + count, [&](std::uint32_t a, std::uint32_t b) {
    return middle(a) != middle(b) ? middle(a) < middle(b) : a < b;
  });
  nodes_[place].count = 0;
  build(first, half);
  const std::uint32_t right = build(first + half, count - half);
  nodes_[place].right = right;
  return place;
}

std::vector<std::uint32_t> ViewIndex::meeting(const std::array<double, 4>& box) const {
  std::vector<std::uint32_t> found, open;
  if (!nodes_.empty()) open.push_back(0);
  while (!open.empty()) {
    const std::uint32_t place = open.back();
    const Node& node = nodes_[place];
    open.pop_back();
    if (!meet(node.box, box)) continue;
    if (node.count == 0) {
      open.push_back(node.right);
      open.push_back(place + 1);
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i)
      if (meet(views_[order_[i]].footprint, box)) found.push_back(order_[i]);
  }
  std::sort(found.begin(), found.end());
  return found;
}

struct TextureBlender::Impl {
  Impl(std::vector<Camera> of_bands, const BlendConfig& blend_config)
      : config(blend_config), cameras(std::move(of_bands)), block(blend_config, fastestBlendKernels()) {}

  BlendCounts blend(Atlas& atlas, const ViewIndex& index, const std::vector<std::uint32_t>& places,
                    const std::vector<const Mesh*>& occluders, const BandSource& images);
  void activate(const ChartLattice& lattice, const ViewIndex& index, const std::vector<std::uint32_t>& places,
                const std::vector<const Mesh*>& occluders, const BandSource& images);

  BlendConfig config;
  std::vector<Camera> cameras;
  BlockBlender block;
  std::vector<ActiveView> views;
  std::vector<std::uint32_t> chosen;
};

void TextureBlender::Impl::activate(const ChartLattice& lattice, const ViewIndex& index,
                                    const std::vector<std::uint32_t>& places,
                                    const std::vector<const Mesh*>& occluders, const BandSource& images) {
  views.clear();
  std::vector<ViewProjection> projections;
  projections.reserve(places.size());
  for (const std::uint32_t place : places) {
    const View& view = index.views()[place];
    projections.emplace_back(cameras[view.camera], view.T_nav_cam, lattice.origin);
  }
  const Occluders surfaces(occluders, lattice.origin);
  for (const std::uint32_t i : chooseViews(lattice, projections, config.views_of_a_place)) {
    auto bands = images(index.views()[places[i]].image);
    if (bands == nullptr) continue;
    const Camera& camera = cameras[index.views()[places[i]].camera];
    assert(bands->image.width == camera.width && bands->image.height == camera.height);
    views.push_back(
        {places[i], projections[i], {}, std::move(bands), static_cast<float>(kFade * camera.height)});
    views.back().depth.draw(surfaces, projections[i]);
  }
}

BlendCounts TextureBlender::Impl::blend(Atlas& atlas, const ViewIndex& index,
                                        const std::vector<std::uint32_t>& places,
                                        const std::vector<const Mesh*>& occluders, const BandSource& images) {
  BlendCounts counts;
  RgbImage& out = atlas.tile.atlas;
  const Rgb given = colourOf(atlas.tile.surface.mesh);
  out = {atlas.width, atlas.height, {}};
  out.rgb.resize(3 * static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  for (int x = 0; x < out.width; ++x) std::copy(given.begin(), given.end(), out.at(x, 0));
  for (int y = 1; y < out.height; ++y) std::copy_n(out.at(0, 0), 3 * out.width, out.at(0, y));

  const ChartLattice lattice(atlas);
  activate(lattice, index, places, occluders, images);
  counts.texels = lattice.texels;
  counts.views = static_cast<std::uint32_t>(views.size());
  const auto tolerance = static_cast<float>(config.tolerance);
  std::optional<ViewVote> vote;
  if (config.vote) {
    vote.emplace(lattice, views, tolerance);
    counts.outvoted = vote->outvoted();
  }
  chosen.clear();
  if (config.mode == BlendMode::kUnblended)
    chosen.assign(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height), kNoView);
  block.begin({&lattice, &views, vote ? &*vote : nullptr, &out, &chosen, tolerance});

  ColourGrid colours;
  for (std::size_t c = 0; c < atlas.charts.size(); ++c) {
    const ChartLattice::Grid& grid = lattice.grids[c];
    const std::size_t nodes = static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
    colours = {grid.columns, grid.rows, std::vector<float>(4 * nodes), std::vector<std::uint8_t>(nodes)};
    for (int j = 0; j + 1 < grid.rows; j += BlockBlender::kCells)
      for (int i = 0; i + 1 < grid.columns; i += BlockBlender::kCells)
        block.blend(atlas.charts[c], c, i, j, colours, counts);
    const std::vector<std::uint8_t> seen = colours.known;
    if (!fillSmoothly(colours))
      for (std::size_t n = 0; n < nodes; ++n) std::copy(given.begin(), given.end(), &colours.values[4 * n]);
    paintRest(atlas.charts[c], lattice, grid, colours, seen, out);
  }
  views.clear();
  return counts;
}

TextureBlender::TextureBlender(const Camera& camera, const BlendConfig& config)
    : TextureBlender(std::vector{camera.scaled(1.0 / config.bands.reduction)}, config) {}

TextureBlender::TextureBlender(std::vector<Camera> cameras, const BlendConfig& config)
    : impl_(std::make_unique<Impl>(std::move(cameras), config)) {}

TextureBlender::~TextureBlender() = default;

const std::vector<std::uint32_t>& TextureBlender::chosen() const {
  return impl_->chosen;
}

BlendCounts TextureBlender::blend(Atlas& atlas, const ViewIndex& index,
                                  const std::vector<std::uint32_t>& views,
                                  const std::vector<const Mesh*>& occluders, const BandSource& images) {
  return impl_->blend(atlas, index, views, occluders, images);
}

BlendCounts TextureBlender::blend(Atlas& atlas, const ViewIndex& index,
                                  const std::vector<std::uint32_t>& views,
                                  const std::vector<const Mesh*>& occluders, const ImageSource& images) {
  return impl_->blend(atlas, index, views, occluders,
                      [&](std::uint32_t image) -> std::shared_ptr<const BandImage> {
                        const RgbImage* found = images(image);
                        if (found == nullptr) return nullptr;
                        return std::make_shared<const BandImage>(makeBands(*found, impl_->config.bands));
                      });
}

}  // namespace fathom::surface
