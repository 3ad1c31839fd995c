#include "sim/sea/ground/shapes.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "sim/sea/ground/noise.hpp"

namespace fathom::sim {
namespace {

constexpr int kMaxSubdivision = 6;  // 81,920 triangles

// Unit sphere from a subdivided icosahedron, triangles counter-clockwise from outside.
TriangleSurface makeSphere(int subdivisions) {
  const float g = static_cast<float>(std::numbers::phi);
  TriangleSurface s;
  s.vertices = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  s.triangles = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                 {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                 {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (Eigen::Vector3f& v : s.vertices) v.normalize();
  for (int i = 0; i < subdivisions; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, fresh] = middles.try_emplace({std::min(a, b), std::max(a, b)},
                                                   static_cast<std::uint32_t>(s.vertices.size()));
      if (fresh) s.vertices.push_back((s.vertices[a] + s.vertices[b]).normalized());
      return at->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    finer.reserve(4 * s.triangles.size());
    for (const auto& [a, b, c] : s.triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.push_back({a, ab, ca});
      finer.push_back({b, bc, ab});
      finer.push_back({c, ca, bc});
      finer.push_back({ab, bc, ca});
    }
    s.triangles = std::move(finer);
  }
  return s;
}

const TriangleSurface& sphere(double radius_m, double edge_m) {
  static const std::array<TriangleSurface, kMaxSubdivision + 1> kSpheres = [] {
    std::array<TriangleSurface, kMaxSubdivision + 1> spheres;
    for (int i = 0; i <= kMaxSubdivision; ++i) spheres[static_cast<std::size_t>(i)] = makeSphere(i);
    return spheres;
  }();
  constexpr double kIcosahedronEdge = 1.05;  // per unit radius
  const double halvings = std::log2(kIcosahedronEdge * radius_m / edge_m);
  return kSpheres[static_cast<std::size_t>(
      std::clamp(static_cast<int>(std::lround(halvings)), 1, kMaxSubdivision))];
}

Eigen::Vector3d randomDirection(GroundRandom& random) {
  const double z = random.uniform(-1, 1), a = random.uniform(0, 2 * std::numbers::pi);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(a), r * std::sin(a), z};
}

// Linear albedos: bare limestone, coralline algae, brown turf, sponge; massive corals.
const Eigen::Vector3d kStoneColours[] = {
    {0.42, 0.38, 0.31}, {0.30, 0.27, 0.22}, {0.46, 0.30, 0.30}, {0.20, 0.19, 0.14}, {0.56, 0.53, 0.46}};
const Eigen::Vector3d kTurf(0.10, 0.095, 0.05);
const Eigen::Vector3d kCoralColours[] = {
    {0.30, 0.23, 0.14}, {0.21, 0.21, 0.13}, {0.29, 0.20, 0.20}, {0.36, 0.30, 0.19}, {0.24, 0.20, 0.23}};

}  // namespace

TriangleSurface makeStone(std::uint64_t seed, double size_m, double edge_m) {
  GroundRandom random(seed, 1);
  TriangleSurface stone = sphere(size_m / 2, edge_m);
  constexpr int kFacets = 11;
  Eigen::Vector3d facets[kFacets];
  double distances[kFacets];
  for (int i = 0; i < kFacets; ++i) {
    facets[i] = randomDirection(random);
    distances[i] = random.uniform(0.55, 0.95);
  }
  const Eigen::Vector3d axes(1.0, random.uniform(0.6, 0.95), random.uniform(0.4, 0.8));
  const Eigen::Vector3d colour = kStoneColours[random.bits() % std::size(kStoneColours)];
  const double brightness = random.uniform(0.7, 1.2), turf_level = random.uniform(-0.6, 1.4);
  const FractalNoise lumps{hash64(seed, 2), 1.3, 4, 0.55};
  const FractalNoise growth{hash64(seed, 3), 0.25, 3, 0.6};
  stone.covers.resize(stone.vertices.size());
  for (std::size_t i = 0; i < stone.vertices.size(); ++i) {
    const Eigen::Vector3d direction = stone.vertices[i].cast<double>();
    double radius = 1.0;
    for (int k = 0; k < kFacets; ++k) {
      const double along = direction.dot(facets[k]);
      if (along > 0.1) radius = std::min(radius, distances[k] / along);
    }
    radius *= 1.0 + 0.07 * lumps(direction);
    const Eigen::Vector3d p = 0.5 * size_m * radius * direction.cwiseProduct(axes);
    stone.vertices[i] = p.cast<float>();
    const double turf = smoothstep(0.0, 0.8, growth(p + Eigen::Vector3d::Constant(5)) - turf_level);
    stone.covers[i] = {srgbFromLinear(Eigen::Vector3d((1 - turf) * colour + turf * kTurf) *
                                      (brightness * (1 + 0.12 * lumps(3 * direction)))),
                       255};
  }
  computeSurfaceNormals(stone);
  return stone;
}

TriangleSurface makeCoralHead(std::uint64_t seed, double size_m, double overhang, double edge_m) {
  GroundRandom random(seed, 4);
  const double radius = size_m / 2;
  TriangleSurface head = sphere(radius, edge_m);
  const double height = radius * random.uniform(0.55, 1.15);  // of the cap above its rim
  const double rim = radius * random.uniform(0.35, 0.7);      // of the rim above the seafloor
  const double foot = rim + 0.35 * radius;  // of the foot, which continues below the seafloor
  const Eigen::Vector3d colour = kCoralColours[random.bits() % std::size(kCoralColours)];
  const double brightness = random.uniform(0.8, 1.3);
  const FractalNoise lobes{hash64(seed, 5), 1.1, 2, 0.5};
  const FractalNoise knobs{hash64(seed, 6), 0.07, 2, 0.5};  // [m], as large as coral colonies' lobes are
  const FractalNoise mottle{hash64(seed, 7), 0.05, 3, 0.6};
  head.covers.resize(head.vertices.size());
  for (std::size_t i = 0; i < head.vertices.size(); ++i) {
    const Eigen::Vector3d d = head.vertices[i].cast<double>();
    const double up = -d.z();
    const double across = std::hypot(d.x(), d.y());
    // Below the rim the head narrows to its foot; the foot stays a column down into the seafloor.
    const double narrow = 1.0 - overhang * smoothstep(0.0, 0.45, -up);
    const double column = up < 0 ? std::max(across, 0.75 * smoothstep(1.0, 0.9, -up)) : across;
    const double bulge = 1.0 + 0.13 * lobes(d + Eigen::Vector3d::Constant(3));
    const double spread = across > 1e-9 ? radius * bulge * narrow * column / across : 0.0;
    Eigen::Vector3d p(spread * d.x(), spread * d.y(),
                      up >= 0 ? -rim - height * bulge * up : -rim + foot * -up);
    const double knob = std::abs(knobs(p));  // folded noise: rounded knobs between sharp grooves
    p += d * (0.018 * std::min(1.0, radius / 0.2) * knob);
    head.vertices[i] = p.cast<float>();
    const double groove = smoothstep(0.0, 0.5, knob);
    const double dead = smoothstep(0.1, 0.7, -up);  // no light, no living coral under the cap
    const double tone = brightness * (0.55 + 0.45 * groove) * (1 + 0.18 * mottle(p)) * (1 - 0.35 * dead);
    head.covers[i] = {srgbFromLinear(colour * std::max(0.1, tone)), 230};
  }
  computeSurfaceNormals(head);
  return head;
}

void place(TriangleSurface& surface, const Eigen::Matrix3f& rotation, const Eigen::Vector3f& translation) {
  for (Eigen::Vector3f& v : surface.vertices) v = rotation * v + translation;
  for (Eigen::Vector3f& n : surface.normals) n = rotation * n;
}

void computeSurfaceNormals(TriangleSurface& surface) {
  surface.normals.assign(surface.vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& [a, b, c] : surface.triangles) {
    const Eigen::Vector3f n =
        (surface.vertices[b] - surface.vertices[a]).cross(surface.vertices[c] - surface.vertices[a]);
    for (std::uint32_t i : {a, b, c}) surface.normals[i] += n;
  }
  for (Eigen::Vector3f& n : surface.normals) {
    const float length = n.norm();
    n = length > 0 ? Eigen::Vector3f(n / length) : Eigen::Vector3f(0, 0, -1);
  }
}

}  // namespace fathom::sim
