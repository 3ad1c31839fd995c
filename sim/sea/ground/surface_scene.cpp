#include "sim/sea/ground/surface_scene.hpp"

#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace fathom::sim {
namespace {

// Embree's device of the process. It has no thread limit, which would apply to all of TBB, also to rendering.
class EmbreeDevice {
 public:
  EmbreeDevice() : device_(rtcNewDevice(nullptr)) {
    if (device_ == nullptr) throw std::runtime_error("Embree does not start on this processor");
  }
  ~EmbreeDevice() { rtcReleaseDevice(device_); }
  EmbreeDevice(const EmbreeDevice&) = delete;
  EmbreeDevice& operator=(const EmbreeDevice&) = delete;
  [[nodiscard]] RTCDevice get() const { return device_; }

 private:
  RTCDevice device_;
};

RTCDevice embree() {
  static const EmbreeDevice device;
  return device.get();
}

RTCRay makeRay(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float limit) {
  RTCRay ray{};
  ray.org_x = origin.x(), ray.org_y = origin.y(), ray.org_z = origin.z();
  ray.dir_x = direction.x(), ray.dir_y = direction.y(), ray.dir_z = direction.z();
  ray.tfar = limit;
  ray.mask = 0xFFFFFFFF;
  return ray;
}

std::array<float, 3> linear(const Rgb& colour) {
  return {linearFromSrgb(colour[0]), linearFromSrgb(colour[1]), linearFromSrgb(colour[2])};
}

// Embree reads vertices sixteen bytes at a time: one spare vertex keeps it inside the buffer.
void shareVertices(RTCGeometry geometry, std::vector<Eigen::Vector3f>& vertices) {
  const std::size_t count = vertices.size();
  vertices.reserve(count + 1);
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, vertices.data(), 0,
                             sizeof(Eigen::Vector3f), count);
}

// Subdivides textured triangles, so that the vertex colours resolve the texture.
void appendTextured(const TriangleSurface& part, const Eigen::Vector3f& origin, Mesh& mesh) {
  constexpr float kSpacing = 0.02F;  // [m]
  for (const auto& t : part.triangles) {
    const auto edge = [&](std::size_t i) {
      return (part.vertices[t[i]] - part.vertices[t[(i + 1) % 3]]).norm();
    };
    const float longest = std::max({edge(0), edge(1), edge(2)});
    const auto n = static_cast<std::uint32_t>(std::max(1.0F, std::ceil(longest / kSpacing)));
    // Row i of the vertices has i + 1, from the first corner to the edge between the others.
    const auto vertex = [first = static_cast<std::uint32_t>(mesh.vertices.size())](
                            std::uint32_t i, std::uint32_t j) { return first + i * (i + 1) / 2 + j; };
    for (std::uint32_t i = 0; i <= n; ++i)
      for (std::uint32_t j = 0; j <= i; ++j) {
        const auto whole = static_cast<float>(n);
        const std::array<float, 3> weights{static_cast<float>(n - i) / whole,
                                           static_cast<float>(i - j) / whole, static_cast<float>(j) / whole};
        Eigen::Vector3f point = origin;
        Eigen::Vector2f st(0, 0);
        for (std::size_t k = 0; k < 3; ++k) {
          point += weights[k] * part.vertices[t[k]];
          st += weights[k] * part.texture_coordinates[t[k]];
        }
        mesh.vertices.push_back(point);
        Rgb colour;
        const std::array<float, 3> albedo = part.texture->sample(st, longest / whole / part.texel_m);
        for (std::size_t c = 0; c < 3; ++c) colour[c] = srgbFromLinear(albedo[c]);
        mesh.colours.push_back(colour);
      }
    for (std::uint32_t i = 0; i < n; ++i)
      for (std::uint32_t j = 0; j <= i; ++j) {
        mesh.triangles.push_back({vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1)});
        if (j < i) mesh.triangles.push_back({vertex(i, j), vertex(i + 1, j + 1), vertex(i, j + 1)});
      }
  }
}

}  // namespace

void TriangleSurface::append(const TriangleSurface& other) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
  normals.insert(normals.end(), other.normals.begin(), other.normals.end());
  covers.insert(covers.end(), other.covers.begin(), other.covers.end());
  for (const auto& t : other.triangles) triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

SurfaceScene::SurfaceScene(const Eigen::Vector3d& origin_nav)
    : origin_(origin_nav), lower_(origin_nav), upper_(origin_nav), scene_(rtcNewScene(embree())) {
  rtcSetSceneFlags(scene_, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT));
}

SurfaceScene::~SurfaceScene() {
  for (RTCGeometry geometry : geometries_) rtcReleaseGeometry(geometry);
  rtcReleaseScene(scene_);
}

void SurfaceScene::attach(RTCGeometry geometry, Part& part) {
  shareVertices(geometry, part.isGrid() ? part.grid.vertices : part.triangles.vertices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(scene_, geometry, static_cast<unsigned>(geometries_.size()));
  geometries_.push_back(geometry);
}

void SurfaceScene::add(GridSurface surface) {
  parts_.push_back(std::make_unique<Part>());
  Part& part = *parts_.back();
  part.grid = std::move(surface);
  RTCGeometry geometry = rtcNewGeometry(embree(), RTC_GEOMETRY_TYPE_GRID);
  part.embree_grid.startVertexID = 0;
  part.embree_grid.stride = static_cast<unsigned>(part.grid.columns);
  part.embree_grid.width = static_cast<unsigned short>(part.grid.columns);
  part.embree_grid.height = static_cast<unsigned short>(part.grid.rows);
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, &part.embree_grid, 0,
                             sizeof(RTCGrid), 1);
  attach(geometry, part);
}

void SurfaceScene::add(TriangleSurface surface) {
  if (surface.triangles.empty()) return;
  parts_.push_back(std::make_unique<Part>());
  Part& part = *parts_.back();
  part.triangles = std::move(surface);
  RTCGeometry geometry = rtcNewGeometry(embree(), RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             part.triangles.triangles.data(), 0, sizeof(part.triangles.triangles[0]),
                             part.triangles.triangles.size());
  attach(geometry, part);
}

void SurfaceScene::commit() {
  // On one thread: with more, the tree, and with it the last bits of hits, would vary.
  oneapi::tbb::task_arena(1).execute([this] { rtcJoinCommitScene(scene_); });
  if (parts_.empty()) return;
  RTCBounds bounds{};
  rtcGetSceneBounds(scene_, &bounds);
  lower_ = origin_ + Eigen::Vector3d(bounds.lower_x, bounds.lower_y, bounds.lower_z);
  upper_ = origin_ + Eigen::Vector3d(bounds.upper_x, bounds.upper_y, bounds.upper_z);
}

SurfacePoint SurfaceScene::look(unsigned geometry, unsigned primitive, float u, float v,
                                float footprint_m) const {
  const Part& part = *parts_[geometry];
  SurfacePoint point;
  if (part.isGrid()) {
    const GridSurface& grid = part.grid;
    const float x = u * static_cast<float>(grid.columns - 1), y = v * static_cast<float>(grid.rows - 1);
    const int column = std::clamp(static_cast<int>(x), 0, grid.columns - 2);
    const int row = std::clamp(static_cast<int>(y), 0, grid.rows - 2);
    const float a = x - static_cast<float>(column), b = y - static_cast<float>(row);
    const float weights[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
    const std::size_t first = static_cast<std::size_t>(row) * static_cast<std::size_t>(grid.columns) +
                              static_cast<std::size_t>(column);
    const std::size_t index[4] = {first, first + 1, first + static_cast<std::size_t>(grid.columns),
                                  first + static_cast<std::size_t>(grid.columns) + 1};
    point.normal.setZero();
    for (int i = 0; i < 4; ++i) {
      const Cover& cover = grid.covers[index[i]];
      point.normal += weights[i] * grid.normals[index[i]];
      const std::array<float, 3> colour = linear(cover.colour);
      for (std::size_t c = 0; c < 3; ++c) point.albedo[c] += weights[i] * colour[c];
      point.hardness += weights[i] * static_cast<float>(cover.hardness) / 255.0F;
    }
    point.normal.normalize();
    point.resolved_m = (grid.vertices[index[3]] - grid.vertices[index[0]]).norm();
    return point;
  }
  const TriangleSurface& mesh = part.triangles;
  const auto& t = mesh.triangles[primitive];
  const float weights[3] = {1 - u - v, u, v};
  point.normal.setZero();
  Eigen::Vector2f st(0, 0);
  for (std::size_t i = 0; i < 3; ++i) {
    point.normal += weights[i] * mesh.normals[t[i]];
    if (mesh.texture) {
      st += weights[i] * mesh.texture_coordinates[t[i]];
    } else {
      const Cover& cover = mesh.covers[t[i]];
      const std::array<float, 3> colour = linear(cover.colour);
      for (std::size_t c = 0; c < 3; ++c) point.albedo[c] += weights[i] * colour[c];
      point.hardness += weights[i] * static_cast<float>(cover.hardness) / 255.0F;
    }
  }
  point.normal.normalize();
  if (mesh.texture) {
    point.albedo = mesh.texture->sample(st, footprint_m / mesh.texel_m);
    point.hardness = 0.5F;
    point.resolved_m = 2.0F * mesh.texel_m;
  } else {
    point.resolved_m = (mesh.vertices[t[0]] - mesh.vertices[t[1]]).norm();
  }
  return point;
}

std::optional<SurfaceHit> SurfaceScene::firstHit(const Eigen::Vector3f& origin,
                                                 const Eigen::Vector3f& unit_direction, float limit_m) const {
  for (const Eigen::Vector3f& direction : {unit_direction, Eigen::Vector3f(unit_direction + kNudge)}) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit hit{};
    hit.ray = makeRay(origin, direction, limit_m);
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_, &context, &hit);
    if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
    return SurfaceHit{hit.ray.tfar,   Eigen::Vector3f(hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z).normalized(),
                      hit.hit.geomID, hit.hit.primID,
                      hit.hit.u,      hit.hit.v};
  }
  return std::nullopt;
}

std::optional<float> SurfaceScene::castRay(const Eigen::Vector3f& origin,
                                           const Eigen::Vector3f& unit_direction, float limit_m) const {
  const std::optional<SurfaceHit> hit = firstHit(origin, unit_direction, limit_m);
  if (!hit) return std::nullopt;
  return hit->distance_m;
}

std::optional<float> SurfaceScene::depthAt(float north_m, float east_m) const {
  constexpr float kStart = 1000.0F;  // above everything [m]
  const auto fall = castRay({north_m, east_m, -kStart}, Eigen::Vector3f(0, 0, 1), 2 * kStart);
  if (!fall) return std::nullopt;
  return *fall - kStart;
}

bool SurfaceScene::occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& unit_direction,
                            float limit_m) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray = makeRay(origin, unit_direction, limit_m);
  rtcOccluded1(scene_, &context, &ray);
  return ray.tfar < 0.0F;
}

Mesh SurfaceScene::mesh() const {
  Mesh mesh;
  const Eigen::Vector3f origin = origin_.cast<float>();
  for (const auto& part : parts_) {
    if (part->triangles.texture) {
      appendTextured(part->triangles, origin, mesh);
      continue;
    }
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (const Eigen::Vector3f& v : part->isGrid() ? part->grid.vertices : part->triangles.vertices)
      mesh.vertices.push_back(v + origin);
    for (const Cover& cover : part->isGrid() ? part->grid.covers : part->triangles.covers)
      mesh.colours.push_back(cover.colour);
    if (!part->isGrid()) {
      for (const auto& t : part->triangles.triangles)
        mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
      continue;
    }
    // The diagonal of a cell is Embree's: from the next column to the next row.
    const auto columns = static_cast<std::uint32_t>(part->grid.columns);
    const auto rows = static_cast<std::uint32_t>(part->grid.rows);
    for (std::uint32_t r = 0; r + 1 < rows; ++r) {
      for (std::uint32_t c = 0; c + 1 < columns; ++c) {
        const std::uint32_t v = first + r * columns + c;
        mesh.triangles.push_back({v, v + 1, v + columns});
        mesh.triangles.push_back({v + columns + 1, v + columns, v + 1});
      }
    }
  }
  return mesh;
}

}  // namespace fathom::sim
