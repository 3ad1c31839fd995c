#include "sim/score/truth_surface.hpp"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/sea/ground/texture_image.hpp"

namespace fathom::sim {
namespace {

// The point of a triangle that is nearest to p (Ericson, Real-Time Collision Detection, section 5.1.5).
Eigen::Vector3d nearestOnTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                  const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const double sum = va + vb + vc;
  if (!(sum > 0)) return a;  // a triangle without area
  return a + vb / sum * ab + vc / sum * ac;
}

Eigen::Vector3d mean(const Points& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

double squaredError(const Points& estimate, const TruthSurface& truth, const SE3& motion) {
  double sum = 0;
  for (const Eigen::Vector3d& p : estimate) {
    const double d = truth.nearest(motion * p).distance;
    sum += d * d;
  }
  return sum;
}

}  // namespace

struct TruthSurface::Impl {
  Mesh mesh;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  struct Query {
    const Mesh* mesh;
    Eigen::Vector3d from, best;
    double squared = std::numeric_limits<double>::infinity();
    std::uint32_t triangle = 0;
  };

  static bool visit(RTCPointQueryFunctionArguments* arguments) {
    auto& query = *static_cast<Query*>(arguments->userPtr);
    const auto& t = query.mesh->triangles[arguments->primID];
    const Eigen::Vector3d candidate = nearestOnTriangle(query.from, query.mesh->vertices[t[0]].cast<double>(),
                                                        query.mesh->vertices[t[1]].cast<double>(),
                                                        query.mesh->vertices[t[2]].cast<double>());
    const double squared = (candidate - query.from).squaredNorm();
    // Ties go to the lower index, so that the order of the visit does not matter.
    const bool better =
        squared < query.squared || (squared == query.squared && arguments->primID < query.triangle);
    if (!better) return false;
    query.squared = squared;
    query.best = candidate;
    query.triangle = arguments->primID;
    arguments->query->radius = std::nextafter(static_cast<float>(std::sqrt(squared)), 1e30F);
    return true;
  }
};

TruthSurface::TruthSurface(Mesh mesh) : impl_(std::make_unique<Impl>()) {
  if (mesh.empty()) throw std::invalid_argument("a true surface needs triangles");
  impl_->mesh = std::move(mesh);
  impl_->device = rtcNewDevice(nullptr);
  if (impl_->device == nullptr) throw std::runtime_error("Embree gives no device");
  impl_->scene = rtcNewScene(impl_->device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  const Mesh& m = impl_->mesh;
  // Embree reads 16 bytes at each vertex: its own buffer is padded.
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), m.vertices.size()));
  auto* triangles = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), m.triangles.size()));
  for (const Eigen::Vector3f& v : m.vertices)
    for (int i = 0; i < 3; ++i) *vertices++ = v[i];
  for (const auto& t : m.triangles)
    for (const std::uint32_t i : t) *triangles++ = i;
  rtcSetGeometryPointQueryFunction(geometry, &Impl::visit);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(impl_->scene);
}

TruthSurface::~TruthSurface() {
  if (impl_->scene != nullptr) rtcReleaseScene(impl_->scene);
  if (impl_->device != nullptr) rtcReleaseDevice(impl_->device);
}

TruthSurface::Nearest TruthSurface::nearest(const Eigen::Vector3d& from) const {
  Impl::Query query{&impl_->mesh, from, from};
  RTCPointQuery point;
  point.x = static_cast<float>(from.x());
  point.y = static_cast<float>(from.y());
  point.z = static_cast<float>(from.z());
  point.time = 0;
  point.radius = std::numeric_limits<float>::infinity();
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(impl_->scene, &point, &context, nullptr, &query);

  Nearest nearest;
  nearest.point = query.best;
  nearest.distance = std::sqrt(query.squared);
  const auto& t = impl_->mesh.triangles[query.triangle];
  const Eigen::Vector3d a = impl_->mesh.vertices[t[0]].cast<double>();
  nearest.normal = (impl_->mesh.vertices[t[1]].cast<double>() - a)
                       .cross(impl_->mesh.vertices[t[2]].cast<double>() - a)
                       .normalized();
  if (!impl_->mesh.colours.empty()) {
    // Barycentric, by areas.
    const Eigen::Vector3d b = impl_->mesh.vertices[t[1]].cast<double>(),
                          c = impl_->mesh.vertices[t[2]].cast<double>();
    const Eigen::Vector3d across = (b - a).cross(c - a);
    const double area = across.squaredNorm();
    const double u = area > 0 ? (nearest.point - a).cross(c - a).dot(across) / area : 0;
    const double v = area > 0 ? (b - a).cross(nearest.point - a).dot(across) / area : 0;
    const double weights[] = {1 - u - v, u, v};
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < 3; ++i)
        nearest.linear[static_cast<Eigen::Index>(i)] +=
            weights[k] * static_cast<double>(linearFromSrgb(impl_->mesh.colours[t[k]][i]));
  }
  return nearest;
}

std::optional<Eigen::Vector3d> TruthSurface::castRay(const Eigen::Vector3d& from,
                                                     const Eigen::Vector3d& direction) const {
  RTCRayHit hit{};
  hit.ray.org_x = static_cast<float>(from.x());
  hit.ray.org_y = static_cast<float>(from.y());
  hit.ray.org_z = static_cast<float>(from.z());
  hit.ray.dir_x = static_cast<float>(direction.x());
  hit.ray.dir_y = static_cast<float>(direction.y());
  hit.ray.dir_z = static_cast<float>(direction.z());
  hit.ray.tnear = 0;
  hit.ray.tfar = std::numeric_limits<float>::infinity();
  hit.ray.mask = ~0U;
  hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(impl_->scene, &context, &hit);
  if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return from + static_cast<double>(hit.ray.tfar) * direction;
}

SE3 alignRigid(const Points& estimate, const Points& truth) {
  if (estimate.empty()) return {};
  Eigen::Matrix3Xd from(3, estimate.size()), to(3, truth.size());
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = estimate[i];
    to.col(static_cast<Eigen::Index>(i)) = truth[i];
  }
  const Eigen::Matrix4d m = rigidAlignment(from, to);
  return {Eigen::Matrix3d(m.topLeftCorner<3, 3>()), Eigen::Vector3d(m.topRightCorner<3, 1>())};
}

SE3 alignLevel(const Points& estimate, const Points& truth) {
  if (estimate.empty()) return {};
  const Eigen::Vector3d from = mean(estimate), to = mean(truth);
  double sine = 0, cosine = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const Eigen::Vector3d a = estimate[i] - from, b = truth[i] - to;
    sine += a.x() * b.y() - a.y() * b.x();
    cosine += a.x() * b.x() + a.y() * b.y();
  }
  const SE3 turn = SE3::fromEuler(0, 0, sine == 0 ? 0 : std::atan2(sine, cosine), Eigen::Vector3d::Zero());
  return {turn.rotation(), to - turn.rotation() * from};
}

SE3 alignSurface(const Points& estimate, const TruthSurface& truth, const SE3& start) {
  constexpr int kIterations = 30;
  constexpr double kConverged = 1e-6;  // last step [m, rad]
  constexpr double kOutlier = 3.0;     // medians
  constexpr double kDamping = 1e-9;    // relative; a plane leaves three motions free
  if (estimate.size() < 6) return start;

  SE3 motion = start;
  std::vector<TruthSurface::Nearest> nearest(estimate.size());
  std::vector<double> distances(estimate.size());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    tbb::parallel_for(std::size_t{0}, estimate.size(), [&](std::size_t i) {
      nearest[i] = truth.nearest(motion * estimate[i]);
      distances[i] = nearest[i].distance;
    });
    const double limit = std::max(kOutlier * median(std::span(distances)), 1e-9);

    // Turns about the points' centre, so that turn and shift do not mix.
    const Eigen::Vector3d centre = motion * mean(estimate);
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    for (std::size_t i = 0; i < estimate.size(); ++i) {
      if (nearest[i].distance > limit || !nearest[i].normal.allFinite()) continue;
      const Eigen::Vector3d p = motion * estimate[i];
      Vector6d row;
      row << nearest[i].normal, (p - centre).cross(nearest[i].normal);
      const double residual = nearest[i].normal.dot(nearest[i].point - p);
      normal += row * row.transpose();
      right += row * residual;
    }
    normal.diagonal().array() += kDamping * normal.trace();
    const Vector6d step = normal.ldlt().solve(right);
    if (!step.allFinite()) break;
    Vector6d turn = Vector6d::Zero();
    turn.tail<3>() = step.tail<3>();
    const SE3 to_centre(Eigen::Quaterniond::Identity(), -centre);
    const SE3 back(Eigen::Quaterniond::Identity(), centre + step.head<3>());
    motion = back * SE3::exp(turn) * to_centre * motion;
    if (step.norm() < kConverged) break;
  }
  return squaredError(estimate, truth, motion) < squaredError(estimate, truth, start) ? motion : start;
}

}  // namespace fathom::sim
