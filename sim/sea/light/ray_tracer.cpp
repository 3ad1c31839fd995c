#include "sim/sea/light/ray_tracer.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace fathom::sim {
namespace {

constexpr int kSize = RayBundle::kSize;
constexpr float kLift = 3e-4F;       // [m], of shadow rays' starts off the surface
constexpr float kMinCosine = 0.25F;  // limits how far a footprint stretches on a slope

struct HitPoints {
  bool hit[kSize];
  float range[kSize];
  Eigen::Vector3f position[kSize];
  Eigen::Vector3f geometric_normal[kSize];  // unit, towards the camera
  SurfacePoint surface[kSize];
};

// First hits of the bundle in one scene, if nearer than those already in `packet`.
void intersect(RTCScene scene, const int* valid, RTCRayHit8& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &context, &packet);
}

void findPoints(const Shot& shot, const RayBundle& rays, HitPoints& points) {
  alignas(32) RTCRayHit8 packet;
  alignas(32) int valid[kSize];
  Eigen::Vector3f directions[kSize], origins[kSize];
  for (int i = 0; i < kSize; ++i) {
    valid[i] = i < rays.count ? -1 : 0;
    const int ray = std::min(i, rays.count - 1);
    const Eigen::Vector2f n = rays.normalised[ray];
    directions[i] = (shot.R_local_cam * Eigen::Vector3f(n.x(), n.y(), 1.0F)).normalized();
    origins[i] = shot.camera + shot.R_local_cam * rays.origin[ray];
    packet.ray.org_x[i] = origins[i].x(), packet.ray.org_y[i] = origins[i].y(),
    packet.ray.org_z[i] = origins[i].z();
    packet.ray.dir_x[i] = directions[i].x(), packet.ray.dir_y[i] = directions[i].y();
    packet.ray.dir_z[i] = directions[i].z();
    packet.ray.tnear[i] = 0, packet.ray.tfar[i] = std::numeric_limits<float>::infinity();
    packet.ray.time[i] = 0, packet.ray.mask[i] = 0xFFFFFFFF, packet.ray.flags[i] = 0;
    packet.ray.id[i] = static_cast<unsigned>(i);
    packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  intersect(shot.bed.scene(), valid, packet);
  bool missed = false;
  for (int i = 0; i < kSize; ++i) {
    valid[i] = i < rays.count && packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID ? -1 : 0;
    if (valid[i] == 0) continue;
    missed = true;
    packet.ray.dir_x[i] += kNudge.x(), packet.ray.dir_y[i] += kNudge.y(), packet.ray.dir_z[i] += kNudge.z();
  }
  if (missed) intersect(shot.bed.scene(), valid, packet);
  for (int i = 0; i < rays.count; ++i) valid[i] = -1;
  float bed_range[kSize];
  std::copy_n(packet.ray.tfar, kSize, bed_range);
  if (shot.moving != nullptr) intersect(shot.moving->scene(), valid, packet);
  for (int i = 0; i < rays.count; ++i) {
    points.hit[i] = packet.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    if (!points.hit[i]) continue;
    const float range = packet.ray.tfar[i];
    points.range[i] = range;
    points.position[i] = origins[i] + range * directions[i];
    Eigen::Vector3f normal(packet.hit.Ng_x[i], packet.hit.Ng_y[i], packet.hit.Ng_z[i]);
    normal.normalize();
    if (normal.dot(directions[i]) > 0) normal = -normal;
    points.geometric_normal[i] = normal;
    const float cosine = std::max(kMinCosine, -normal.dot(directions[i]));
    const float footprint = range / (shot.focal_px * std::sqrt(cosine));
    const bool moving = range < bed_range[i];
    SurfacePoint& surface = points.surface[i];
    surface =
        (moving ? *shot.moving : shot.bed)
            .look(packet.hit.geomID[i], packet.hit.primID[i], packet.hit.u[i], packet.hit.v[i], footprint);
    if (surface.normal.dot(normal) < 0) surface.normal = -surface.normal;
    if (!moving) shot.detail.apply(points.position[i], footprint, surface);
  }
}

// Clears the occluded rays in `valid`.
void findShadows(const Shot& shot, RTCRay8& packet, int* valid) {
  const auto shadow = [&](RTCScene scene) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcOccluded8(valid, scene, &context, &packet);
    for (int i = 0; i < kSize; ++i)
      if (packet.tfar[i] < 0) valid[i] = 0;
  };
  shadow(shot.bed.scene());
  if (shot.moving != nullptr) shadow(shot.moving->scene());
}

void setRay(RTCRay8& packet, int i, const Eigen::Vector3f& from, const Eigen::Vector3f& direction,
            float length) {
  packet.org_x[i] = from.x(), packet.org_y[i] = from.y(), packet.org_z[i] = from.z();
  packet.dir_x[i] = direction.x(), packet.dir_y[i] = direction.y(), packet.dir_z[i] = direction.z();
  packet.tnear[i] = 0, packet.tfar[i] = length;
  packet.time[i] = 0, packet.mask[i] = 0xFFFFFFFF, packet.flags[i] = 0,
  packet.id[i] = static_cast<unsigned>(i);
}

// Adds the light of one strobe to the irradiances.
void illuminate(const Shot& shot, std::size_t strobe, const HitPoints& points, RayBundle& rays) {
  alignas(32) RTCRay8 packet;
  alignas(32) int valid[kSize];
  float strength[kSize], distance[kSize];
  bool any = false;
  for (int i = 0; i < kSize; ++i) {
    valid[i] = 0;
    packet.tfar[i] = -1;
    if (i >= rays.count || !points.hit[i]) continue;
    const Eigen::Vector3f start = points.position[i] + kLift * points.geometric_normal[i];
    const Eigen::Vector3f to = shot.strobe_positions[strobe] - start;
    distance[i] = to.norm();
    const Eigen::Vector3f direction = to / distance[i];
    if (points.geometric_normal[i].dot(direction) <= 0) continue;
    const float cosine = points.surface[i].normal.dot(direction);
    strength[i] = shot.beams[strobe](-direction.dot(shot.strobe_directions[strobe])) *
                  std::max(0.0F, cosine) / (distance[i] * distance[i]);
    if (strength[i] <= 0) {  // grains turned away from the light are no shadow's edge
      rays.lit[i] |= 1U << strobe;
      continue;
    }
    valid[i] = -1;
    any = true;
    setRay(packet, i, start, direction, distance[i]);
  }
  if (!any) return;
  findShadows(shot, packet, valid);
  for (int i = 0; i < rays.count; ++i) {
    if (valid[i] == 0) continue;
    rays.lit[i] |= 1U << strobe;
    const Radiance left = shot.attenuation(distance[i] + points.range[i]);
    for (std::size_t c = 0; c < 3; ++c) rays.radiance[i][c] += strength[i] * left[c];
  }
}

// Adds the light of sun and sky to the irradiances.
void illuminateByDay(const Shot& shot, const HitPoints& points, RayBundle& rays) {
  alignas(32) RTCRay8 packet;
  alignas(32) int valid[kSize];
  for (int i = 0; i < kSize; ++i) {
    valid[i] =
        i < rays.count && points.hit[i] && points.geometric_normal[i].dot(shot.daylight.toSun()) > 0 ? -1 : 0;
    packet.tfar[i] = -1;
    if (valid[i] == 0) continue;
    setRay(packet, i, points.position[i] + kLift * points.geometric_normal[i], shot.daylight.toSun(),
           std::numeric_limits<float>::infinity());
  }
  findShadows(shot, packet, valid);
  for (int i = 0; i < rays.count; ++i) {
    if (!points.hit[i]) continue;
    const float depth = shot.origin_depth + points.position[i].z();
    const Eigen::Vector3f place = points.position[i] + Eigen::Vector3f(0, 0, shot.origin_depth);
    const Radiance day = shot.daylight.irradiance(depth, place, points.surface[i].normal, valid[i] != 0);
    const Radiance left = shot.attenuation(points.range[i]);
    for (std::size_t c = 0; c < 3; ++c) rays.radiance[i][c] += day[c] * left[c];
  }
}

}  // namespace

void trace(const Shot& shot, RayBundle& rays) {
  HitPoints points;
  findPoints(shot, rays, points);
  for (int i = 0; i < rays.count; ++i) {
    rays.radiance[i] = {0, 0, 0};
    rays.lit[i] = 0;
    rays.inverse_range[i] = points.hit[i] ? 1.0F / points.range[i] : 0.0F;
  }
  for (std::size_t s = 0; s < shot.strobe_positions.size(); ++s) illuminate(shot, s, points, rays);
  if (shot.daylight.on()) illuminateByDay(shot, points, rays);
  for (int i = 0; i < rays.count; ++i) {
    constexpr float kEndless = 1e6F;  // [m]: the table's last entry
    const float range = points.hit[i] ? points.range[i] : kEndless;
    Radiance haze = shot.backscatter.at(rays.x_px[i], rays.y_px[i], range);
    if (shot.daylight.on()) {
      const Eigen::Vector3f along(rays.normalised[i].x(), rays.normalised[i].y(), 1.0F);
      const float down = (shot.R_local_cam * along).z() / along.norm();
      const Radiance veil = shot.daylight.veil(shot.origin_depth + shot.camera.z(), down, range);
      for (std::size_t c = 0; c < 3; ++c) haze[c] += veil[c];
    }
    for (std::size_t c = 0; c < 3; ++c) {
      const float albedo = points.hit[i] ? points.surface[i].albedo[c] : 0.0F;
      rays.radiance[i][c] = albedo / static_cast<float>(std::numbers::pi) * rays.radiance[i][c] + haze[c];
    }
  }
}

}  // namespace fathom::sim
