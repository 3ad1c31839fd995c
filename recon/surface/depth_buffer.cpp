#include "recon/surface/depth_buffer.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace fathom::surface {
namespace {

// Margin by which occluders are enlarged [cells]: a pixel at their edge shows both surfaces, and poses shift
// it by a few pixels.
constexpr float kMargin = 1.0F;
constexpr float kPatchEdge = 0.3F;  // [m]

struct Member {
  std::int32_t x = 0, y = 0;  // of the patch [kPatchEdge]
  std::uint32_t mesh = 0, triangle = 0;
};

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
  // Barycentric coordinates of b and c, and from them inverse depth: all linear over the picture.
  const float per_area = 1.0F / area;
  const float bx = (c.y - a.y) * per_area, by = (a.x - c.x) * per_area;
  const float cx = (a.y - b.y) * per_area, cy = (b.x - a.x) * per_area;
  const float gx = bx * (b.inverse - a.inverse) + cx * (c.inverse - a.inverse);
  const float gy = by * (b.inverse - a.inverse) + cy * (c.inverse - a.inverse);
  const float farthest = std::min({a.inverse, b.inverse, c.inverse});
  const float back = kMargin * (std::abs(gx) + std::abs(gy));
  const float rim_b = -kMargin * (std::abs(bx) + std::abs(by)),
              rim_c = -kMargin * (std::abs(cx) + std::abs(cy));
  const float rim_a = 1 + kMargin * (std::abs(bx + cx) + std::abs(by + cy));
  for (int y = y0; y <= y1; ++y) {
    float* row = &nearest_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_)];
    const float dy = static_cast<float>(y) - a.y;
    for (int x = x0; x <= x1; ++x) {
      const float dx = static_cast<float>(x) - a.x;
      const float wb = bx * dx + by * dy, wc = cx * dx + cy * dy;
      if (wb < rim_b || wc < rim_c || wb + wc > rim_a) continue;
      row[x] = std::max(row[x], std::max(farthest, a.inverse + gx * dx + gy * dy - back));
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

}  // namespace fathom::surface
