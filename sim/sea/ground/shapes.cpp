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

constexpr double kSwellPeriod = 7.0;  // [s]

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

MovingObjects::MovingObjects(const TerrainConfig& config, const SurfaceScene& bed) : bed_(bed) {
  const Eigen::Vector3d low = bed.lower() - bed.origin(), high = bed.upper() - bed.origin();
  for (int i = 0; i < config.fish; ++i) {
    GroundRandom random(hash64(config.seed, 400), static_cast<std::uint64_t>(i));
    fish_.push_back({.length_m = random.uniform(0.12, 0.45),
                     .speed_mps = random.uniform(0.15, 0.7),
                     .circuit_m = random.uniform(1.0, 4.0),
                     .phase = random.uniform(0, 2 * std::numbers::pi),
                     .height_m = random.uniform(0.3, 1.1),
                     .centre = {random.uniform(low.x(), high.x()), random.uniform(low.y(), high.y())}});
  }
  const auto tufts = static_cast<std::uint64_t>(
      std::lround(config.swaying_density_per_m2 * (high.x() - low.x()) * (high.y() - low.y())));
  const FractalNoise meadow{hash64(config.seed, 401), 2.5, 3, 0.5};
  for (std::uint64_t i = 0; i < tufts; ++i) {
    GroundRandom random(hash64(config.seed, 402), i);
    const double north = random.uniform(low.x(), high.x()), east = random.uniform(low.y(), high.y());
    if (meadow(north, east) < random.uniform(-1.5, 1.0)) continue;
    const double length = random.uniform(0.12, 0.35);
    constexpr int kBladesPerTuft = 7;
    for (int k = 0; k < kBladesPerTuft; ++k) {
      const double n = north + random.uniform(-0.04, 0.04), e = east + random.uniform(-0.04, 0.04);
      const auto depth = bed.depthAt(static_cast<float>(n), static_cast<float>(e));
      if (!depth) continue;
      blades_.push_back({.root = {static_cast<float>(n), static_cast<float>(e), *depth},
                         .length_m = static_cast<float>(length * random.uniform(0.6, 1.1)),
                         .width_m = static_cast<float>(random.uniform(0.008, 0.02)),
                         .tilt_rad = static_cast<float>(random.uniform(0.1, 0.9)),
                         .turn_rad = static_cast<float>(random.uniform(0, 2 * std::numbers::pi)),
                         .tone = static_cast<float>(random.uniform(0.7, 1.3))});
    }
  }
}

Eigen::Vector2d MovingObjects::placeOf(const Fish& fish, double time_s) {
  const double a = fish.phase + fish.speed_mps / fish.circuit_m * time_s;
  return fish.centre + fish.circuit_m * Eigen::Vector2d(std::cos(a), std::sin(a));
}

TriangleSurface MovingObjects::fishAt(const Fish& fish, const Eigen::Vector2d& place, double time_s) const {
  // Along x from nose to tail, flat to its sides: a spindle, then a tail fin.
  constexpr int kRings = 17, kAround = 12;
  constexpr double kTailStart = 0.82;  // of its length
  TriangleSurface body;
  const double beat = 2 * std::numbers::pi * (0.8 + fish.speed_mps / fish.length_m) * time_s + fish.phase;
  for (int ring = 0; ring < kRings; ++ring) {
    const double s = static_cast<double>(ring) / (kRings - 1);
    const double spindle =
        s < kTailStart ? std::sin(std::numbers::pi * std::pow(s / (kTailStart + 0.06), 0.65)) : 0.0;
    const double fin = s < kTailStart ? 0.0 : 0.13 * (s - kTailStart) / (1 - kTailStart) + 0.02;
    const double half_width = fish.length_m * (0.075 * spindle + 0.004);
    const double half_height = fish.length_m * (0.15 * spindle + fin + 0.004);
    const double bend = 0.09 * fish.length_m * s * s * std::sin(beat - 4 * s);
    for (int k = 0; k < kAround; ++k) {
      const double a = 2 * std::numbers::pi * k / kAround;
      body.vertices.emplace_back(static_cast<float>(fish.length_m * (0.5 - s)),
                                 static_cast<float>(bend + half_width * std::sin(a)),
                                 static_cast<float>(-half_height * std::cos(a)));
      const double belly = 0.5 - 0.5 * std::cos(a);  // dark above, pale below
      const double bar = 0.75 + 0.25 * std::sin(38 * s);
      body.covers.push_back({srgbFromLinear(bar * (Eigen::Vector3d(0.10, 0.12, 0.13) +
                                                   belly * Eigen::Vector3d(0.45, 0.45, 0.42))),
                             0});
    }
  }
  for (std::uint32_t ring = 0; ring + 1 < kRings; ++ring) {
    for (std::uint32_t k = 0; k < kAround; ++k) {
      const std::uint32_t a = ring * kAround + k, b = ring * kAround + (k + 1) % kAround;
      body.triangles.push_back({a, a + kAround, b});
      body.triangles.push_back({b, a + kAround, b + kAround});
    }
  }
  computeSurfaceNormals(body);
  const double heading = fish.phase + fish.speed_mps / fish.circuit_m * time_s + std::numbers::pi / 2;
  const auto depth = bed_.depthAt(static_cast<float>(place.x()), static_cast<float>(place.y()));
  const double z = depth ? *depth - fish.height_m : -fish.height_m;
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  sim::place(body, rotation.cast<float>(), Eigen::Vector3d(place.x(), place.y(), z).cast<float>());
  return body;
}

TriangleSurface MovingObjects::bladeAt(const Blade& blade, double time_s) {
  constexpr std::uint32_t kSegments = 7;
  TriangleSurface ribbon;
  // The swell travels: neighbouring blades sway nearly in phase.
  const double sway = 0.55 * std::sin(2 * std::numbers::pi * time_s / kSwellPeriod + 0.6 * blade.root.x() +
                                      0.3 * blade.root.y());
  const Eigen::Vector3f tilt(std::cos(blade.turn_rad), std::sin(blade.turn_rad), 0);
  const Eigen::Vector3f side = tilt.cross(Eigen::Vector3f::UnitZ());
  Eigen::Vector3f p = blade.root;
  for (std::uint32_t i = 0; i <= kSegments; ++i) {
    const float s = static_cast<float>(i) / kSegments;
    const float width = blade.width_m * (1.0F - 0.8F * s * s);
    ribbon.vertices.push_back(p + 0.5F * width * side);
    ribbon.vertices.push_back(p - 0.5F * width * side);
    const Cover cover{srgbFromLinear((0.6 + 0.6 * s) * blade.tone * Eigen::Vector3d(0.10, 0.15, 0.045)), 60};
    ribbon.covers.insert(ribbon.covers.end(), 2, cover);
    Eigen::Vector3f direction = Eigen::Vector3f(0, 0, -1) + s * std::tan(blade.tilt_rad) * tilt +
                                s * static_cast<float>(sway) * Eigen::Vector3f(1, 0, 0);
    p += blade.length_m / kSegments * direction.normalized();
    if (i == kSegments) break;
    const std::uint32_t v = 2 * i;
    ribbon.triangles.push_back({v, v + 1, v + 2});
    ribbon.triangles.push_back({v + 2, v + 1, v + 3});
  }
  computeSurfaceNormals(ribbon);
  return ribbon;
}

std::unique_ptr<SurfaceScene> MovingObjects::near(const Eigen::Vector3f& centre, float radius_m,
                                                  double time_s) const {
  TriangleSurface all;
  for (const Fish& fish : fish_) {
    const Eigen::Vector2d place = placeOf(fish, time_s);
    if ((place - centre.head<2>().cast<double>()).norm() < static_cast<double>(radius_m))
      all.append(fishAt(fish, place, time_s));
  }
  for (const Blade& blade : blades_)
    if ((blade.root.head<2>() - centre.head<2>()).norm() < radius_m) all.append(bladeAt(blade, time_s));
  if (all.triangles.empty()) return nullptr;
  auto scene = std::make_unique<SurfaceScene>(bed_.origin());
  scene->add(std::move(all));
  scene->commit();
  return scene;
}

}  // namespace fathom::sim
