#include "recon/surface/view_vote.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "recon/surface/kernels/blend_kernels.hpp"

namespace fathom::surface {
namespace {

// Margin by which occluders are enlarged [cells]: pixels at an edge mix both surfaces, and errors of poses
// displace edges by a few pixels.
constexpr float kMargin = 1.0F;
constexpr float kPatchEdge = 0.3F;  // [m]

struct Member {
  std::int32_t x = 0, y = 0;  // index of the patch, in units of kPatchEdge
  std::uint32_t mesh = 0, triangle = 0;
};

constexpr std::size_t kLeastViews = 3;  // a majority needs so many
// Difference of logarithms, 35 %, above what the lighting correction leaves.
constexpr float kLimit = 0.30F;
constexpr float kSpread = 3.0F;  // times the median difference of all views at the node
// Difference of logarithms above which neighbours of an outlier are outliers too: the low band spreads its
// colour.
constexpr float kFringe = 0.12F;
// Grey levels added before the logarithm, so that noise of dark nodes stays small.
constexpr float kDark = 12.0F;

// log(v) for v >= 1, to 1e-4, the same on every processor.
float logarithm(float v) {
  int exponent = 0;
  const float m = std::frexp(v, &exponent);  // 0.5 to 1
  const float t = (m - 0.70710678F) / (m + 0.70710678F), t2 = t * t;
  return 2 * t * (1 + t2 * (1.0F / 3 + t2 * (1.0F / 5 + t2 / 7))) +
         0.69314718F * (static_cast<float>(exponent) - 0.5F);
}

float medianOf(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5F * (*middle + *std::max_element(values.begin(), middle));
}

}  // namespace

Occluders::Occluders(const std::vector<const Mesh*>& meshes, const Eigen::Vector3d& origin) {
  const Eigen::Vector3f base = origin.cast<float>();
  std::vector<Member> members;
  for (std::uint32_t m = 0; m < meshes.size(); ++m) {
    const Mesh& mesh = *meshes[m];
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto& [a, b, c] = mesh.triangles[t];
      const Eigen::Vector3f middle = (mesh.vertices[a] + mesh.vertices[b] + mesh.vertices[c]) / 3.0F - base;
      members.push_back({static_cast<std::int32_t>(std::floor(middle.x() / kPatchEdge)),
                         static_cast<std::int32_t>(std::floor(middle.y() / kPatchEdge)), m, t});
    }
  }
  std::sort(members.begin(), members.end(), [](const Member& a, const Member& b) {
    return std::tie(a.x, a.y, a.mesh, a.triangle) < std::tie(b.x, b.y, b.mesh, b.triangle);
  });
  triangles.reserve(members.size());
  std::vector<std::vector<std::uint32_t>> place;  // of a mesh's vertex in `vertices`, plus 1
  place.reserve(meshes.size());
  for (const Mesh* mesh : meshes) place.emplace_back(mesh->vertices.size(), 0);
  for (std::size_t i = 0; i < members.size(); ++i) {
    if (i == 0 || members[i].x != members[i - 1].x || members[i].y != members[i - 1].y) {
      Patch& next = patches.emplace_back();
      next.first_vertex = static_cast<std::uint32_t>(vertices.size());
      next.first_triangle = static_cast<std::uint32_t>(triangles.size());
    }
    Patch& patch = patches.back();
    const Mesh& mesh = *meshes[members[i].mesh];
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t vertex = mesh.triangles[members[i].triangle][k];
      std::uint32_t& at = place[members[i].mesh][vertex];
      if (at <= patch.first_vertex) {
        vertices.emplace_back(mesh.vertices[vertex] - base);
        at = static_cast<std::uint32_t>(vertices.size());
        ++patch.vertices;
      }
      corners[k] = at - 1 - patch.first_vertex;
    }
    triangles.push_back(corners);
    ++patch.triangles;
  }
  for (Patch& patch : patches) {
    Eigen::Vector3f low = vertices[patch.first_vertex], high = low;
    for (std::uint32_t v = 0; v < patch.vertices; ++v) {
      low = low.cwiseMin(vertices[patch.first_vertex + v]);
      high = high.cwiseMax(vertices[patch.first_vertex + v]);
    }
    patch.middle = 0.5F * (low + high);
    patch.radius = 0.5F * (high - low).norm();
  }
}

void DepthBuffer::draw(const Occluders& occluders, const ViewProjection& view) {
  width_ = (static_cast<int>(view.width) + kCell - 1) / kCell;
  height_ = (static_cast<int>(view.height) + kCell - 1) / kCell;
  nearest_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), 0.0F);
  constexpr float kPerPixel = 1.0F / kCell, kCentre = 0.5F * (kCell - 1);  // a cell's centre [px]
  for (const Occluders::Patch& patch : occluders.patches) {
    if (!view.mayMeet(patch.middle, patch.radius)) continue;
    projected_.clear();
    for (std::uint32_t v = 0; v < patch.vertices; ++v) {
      const Eigen::Vector3f& p = occluders.vertices[patch.first_vertex + v];
      const auto pixel = view.project(p.x(), p.y(), p.z());
      projected_.push_back({(pixel.u - kCentre) * kPerPixel, (pixel.v - kCentre) * kPerPixel,
                            pixel.valid ? 1.0F / pixel.depth : 0.0F});
    }
    for (std::uint32_t t = 0; t < patch.triangles; ++t) {
      const auto& [a, b, c] = occluders.triangles[patch.first_triangle + t];
      drawTriangle(projected_[a], projected_[b], projected_[c]);
    }
  }
}

void DepthBuffer::drawTriangle(const Vertex& a, const Vertex& b, const Vertex& c) {
  if (a.inverse == 0 || b.inverse == 0 || c.inverse == 0) return;
  const auto low = [](float p, float q, float r) {
    return static_cast<int>(std::ceil(std::max(0.0F, std::min({p, q, r}) - kMargin)));
  };
  const auto high = [](float p, float q, float r, int cells) {
    return static_cast<int>(
        std::floor(std::min(static_cast<float>(cells - 1), std::max({p, q, r}) + kMargin)));
  };
  const int x0 = low(a.x, b.x, c.x), x1 = high(a.x, b.x, c.x, width_);
  const int y0 = low(a.y, b.y, c.y), y1 = high(a.y, b.y, c.y, height_);
  if (x0 > x1 || y0 > y1) return;
  const float area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
  if (area == 0) return;
  // Barycentric coordinates of b and c, and from them inverse depth: all affine in image coordinates.
  const float per_area = 1.0F / area;
  const float bx = (c.y - a.y) * per_area, by = (a.x - c.x) * per_area;
  const float cx = (a.y - b.y) * per_area, cy = (b.x - a.x) * per_area;
  const float gx = bx * (b.inverse - a.inverse) + cx * (c.inverse - a.inverse);
  const float gy = by * (b.inverse - a.inverse) + cy * (c.inverse - a.inverse);
  const float least_inverse = std::min({a.inverse, b.inverse, c.inverse});
  const float inverse_margin = kMargin * (std::abs(gx) + std::abs(gy));
  const float least_b = -kMargin * (std::abs(bx) + std::abs(by)),
              least_c = -kMargin * (std::abs(cx) + std::abs(cy));
  const float most_bc = 1 + kMargin * (std::abs(bx + cx) + std::abs(by + cy));
  for (int y = y0; y <= y1; ++y) {
    float* row = &nearest_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_)];
    const float dy = static_cast<float>(y) - a.y;
    for (int x = x0; x <= x1; ++x) {
      const float dx = static_cast<float>(x) - a.x;
      const float wb = bx * dx + by * dy, wc = cx * dx + cy * dy;
      if (wb < least_b || wc < least_c || wb + wc > most_bc) continue;
      row[x] = std::max(row[x], std::max(least_inverse, a.inverse + gx * dx + gy * dy - inverse_margin));
    }
  }
}

float DepthBuffer::visibility(float u, float v, float depth, float tolerance) const {
  constexpr float kPerPixel = 1.0F / kCell, kCentre = 0.5F * (kCell - 1);
  const float x = std::clamp((u - kCentre) * kPerPixel, 0.0F, static_cast<float>(width_ - 1));
  const float y = std::clamp((v - kCentre) * kPerPixel, 0.0F, static_cast<float>(height_ - 1));
  const int xi = std::min(static_cast<int>(x), width_ - 2), yi = std::min(static_cast<int>(y), height_ - 2);
  const float fx = x - static_cast<float>(xi), fy = y - static_cast<float>(yi);
  const float* row = &nearest_[static_cast<std::size_t>(yi) * static_cast<std::size_t>(width_) +
                               static_cast<std::size_t>(xi)];
  // Hidden where depth > 1 / nearest + tolerance.
  const float within = depth - tolerance;
  const auto visible = [&](std::ptrdiff_t at) { return row[at] * within <= 1.0F ? 1.0F : 0.0F; };
  const float s00 = visible(0), s01 = visible(1), s10 = visible(width_), s11 = visible(width_ + 1);
  const float top = s00 + fx * (s01 - s00), bottom = s10 + fx * (s11 - s10);
  return std::clamp(2 * (top + fy * (bottom - top)) - 1, 0.0F, 1.0F);
}

ViewVote::ViewVote(const ChartLattice& lattice, const std::vector<ActiveView>& views, float tolerance)
    : views_(views.size()) {
  const auto count = [](int nodes) { return (nodes - 2) / kStep + 2; };
  for (const ChartLattice::Grid& from : lattice.grids) {
    grids_.push_back({count(from.columns), count(from.rows), nodes_});
    nodes_ += static_cast<std::size_t>(grids_.back().columns) * static_cast<std::size_t>(grids_.back().rows);
  }
  if (views_ < kLeastViews) return;
  sample(lattice, views, tolerance);
  removeGains();
  flagOutliers();
  if (outvoted_ > 0) spread();
}

void ViewVote::sample(const ChartLattice& lattice, const std::vector<ActiveView>& views, float tolerance) {
  std::vector<float> points[6];
  for (auto& values : points) values.resize(nodes_);
  std::vector<std::uint8_t> known(nodes_);
  for (std::size_t c = 0; c < grids_.size(); ++c) {
    const Grid& grid = grids_[c];
    const ChartLattice::Grid& from = lattice.grids[c];
    std::size_t to = grid.first;
    for (int b = 0; b < grid.rows; ++b) {
      for (int a = 0; a < grid.columns; ++a, ++to) {
        const std::size_t node =
            from.node(std::min(a * kStep, from.columns - 1), std::min(b * kStep, from.rows - 1));
        known[to] = lattice.known[node];
        points[0][to] = lattice.x[node], points[1][to] = lattice.y[node], points[2][to] = lattice.z[node];
        points[3][to] = lattice.nx[node], points[4][to] = lattice.ny[node], points[5][to] = lattice.nz[node];
      }
    }
  }
  colour_.assign(3 * views_ * nodes_, 0.0F);
  seen_.assign(views_ * nodes_, 0);
  outlier_.assign(views_ * nodes_, 0);
  difference_.assign(views_ * nodes_, 0.0F);
  std::vector<float> pixels[5], band(4 * nodes_), unused(4 * nodes_), one(nodes_), zero(nodes_, 0.0F);
  for (auto& values : pixels) values.resize(nodes_);
  const NodePoints nodes{static_cast<int>(nodes_), points[0].data(), points[1].data(), points[2].data(),
                         points[3].data(),         points[4].data(), points[5].data()};
  const NodePixels at{pixels[0].data(), pixels[1].data(), pixels[2].data(), pixels[3].data(),
                      pixels[4].data()};
  const BlendKernels& kernels = fastestBlendKernels();
  for (std::size_t view = 0; view < views_; ++view) {
    kernels.projectNodes(views[view].projection, nodes, views[view].fade, at);
    for (std::size_t i = 0; i < nodes_; ++i) {
      const bool visible = known[i] != 0 && at.freedom[i] > 0 &&
                           views[view].depth.visibility(at.u[i], at.v[i], at.depth[i], tolerance) > 0 &&
                           views[view].bands->openness(at.u[i], at.v[i], views[view].fade) > 0;
      one[i] = visible ? 1.0F : 0.0F;
      seen_[view * nodes_ + i] = visible;
    }
    std::fill(band.begin(), band.end(), 0.0F);
    kernels.gatherBands(views[view].bands->fine, views[view].bands->coarse, at.u, at.v, one.data(),
                        zero.data(), zero.data(), nodes.count, band.data(), unused.data());
    for (std::size_t i = 0; i < nodes_; ++i)
      if (seen_[view * nodes_ + i] != 0)
        for (std::size_t c = 0; c < 3; ++c)
          colour_[3 * (view * nodes_ + i) + c] = logarithm(kDark + band[4 * i + c]);
  }
}

void ViewVote::removeGains() {
  std::vector<std::vector<float>> deviations(3 * views_);
  std::vector<float> all;
  for (std::size_t i = 0; i < nodes_; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      all.clear();
      for (std::size_t view = 0; view < views_; ++view)
        if (seen_[view * nodes_ + i] != 0) all.push_back(colour_[3 * (view * nodes_ + i) + c]);
      if (all.size() < 2) continue;
      const float median = medianOf(all);
      for (std::size_t view = 0; view < views_; ++view)
        if (seen_[view * nodes_ + i] != 0)
          deviations[3 * view + c].push_back(colour_[3 * (view * nodes_ + i) + c] - median);
    }
  }
  for (std::size_t view = 0; view < views_; ++view) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (deviations[3 * view + c].empty()) continue;
      const float gain = medianOf(deviations[3 * view + c]);
      for (std::size_t i = 0; i < nodes_; ++i) colour_[3 * (view * nodes_ + i) + c] -= gain;
    }
  }
}

void ViewVote::flagOutliers() {
  std::vector<float> all;
  std::vector<std::size_t> voters;
  for (std::size_t i = 0; i < nodes_; ++i) {
    voters.clear();
    for (std::size_t view = 0; view < views_; ++view)
      if (seen_[view * nodes_ + i] != 0) voters.push_back(view * nodes_ + i);
    if (voters.size() < kLeastViews) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      all.clear();
      for (const std::size_t at : voters) all.push_back(colour_[3 * at + c]);
      const float median = medianOf(all);
      for (const std::size_t at : voters)
        difference_[at] = std::max(difference_[at], std::abs(colour_[3 * at + c] - median));
    }
    all.clear();
    for (const std::size_t at : voters) all.push_back(difference_[at]);
    const float limit = std::max(kLimit, kSpread * medianOf(all));
    for (const std::size_t at : voters) {
      if (difference_[at] <= limit) continue;
      outlier_[at] = 1;
      ++outvoted_;
    }
  }
}

void ViewVote::spread() {
  std::vector<std::pair<int, int>> open;
  for (std::size_t view = 0; view < views_; ++view) {
    for (const Grid& grid : grids_) {
      const std::size_t base = view * nodes_ + grid.first;
      const auto place = [&](int a, int b) {
        return base + static_cast<std::size_t>(b) * static_cast<std::size_t>(grid.columns) +
               static_cast<std::size_t>(a);
      };
      open.clear();
      for (int b = 0; b < grid.rows; ++b)
        for (int a = 0; a < grid.columns; ++a)
          if (outlier_[place(a, b)] != 0) open.emplace_back(a, b);
      const auto neighbours = [&](int a, int b, const auto& visit) {
        for (int v = std::max(0, b - 1); v <= std::min(grid.rows - 1, b + 1); ++v)
          for (int u = std::max(0, a - 1); u <= std::min(grid.columns - 1, a + 1); ++u) visit(u, v);
      };
      while (!open.empty()) {
        const auto [a, b] = open.back();
        open.pop_back();
        neighbours(a, b, [&](int u, int v) {
          const std::size_t at = place(u, v);
          if (outlier_[at] != 0 || difference_[at] <= kFringe) return;
          outlier_[at] = 1;
          open.emplace_back(u, v);
        });
      }
      std::vector<std::pair<int, int>> rim;
      for (int b = 0; b < grid.rows; ++b)
        for (int a = 0; a < grid.columns; ++a)
          if (outlier_[place(a, b)] != 0) neighbours(a, b, [&](int u, int v) { rim.emplace_back(u, v); });
      for (const auto& [a, b] : rim) outlier_[place(a, b)] = 1;
    }
  }
}

void ViewVote::factors(std::size_t view, std::size_t chart, int j, int i0, int i1, float* out) const {
  const Grid& grid = grids_[chart];
  const auto row = static_cast<std::size_t>(std::min(j / kStep, grid.rows - 1));
  const std::size_t below = std::min(row + 1, static_cast<std::size_t>(grid.rows) - 1);
  const float fy = static_cast<float>(j % kStep) / kStep;
  const std::uint8_t* first = &outlier_[view * nodes_ + grid.first];
  const std::uint8_t* top = first + row * static_cast<std::size_t>(grid.columns);
  const std::uint8_t* bottom = first + below * static_cast<std::size_t>(grid.columns);
  const auto at = [&](int a) {
    const int inside = std::min(a, grid.columns - 1);
    const auto t = static_cast<float>(top[inside]), b = static_cast<float>(bottom[inside]);
    return t + fy * (b - t);
  };
  for (int i = i0; i < i1; ++i) {
    const float left = at(i / kStep), right = at(i / kStep + 1);
    out[i - i0] = 1 - (left + static_cast<float>(i % kStep) / kStep * (right - left));
  }
}

}  // namespace fathom::surface
