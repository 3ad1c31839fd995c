#include "recon/fusion/volumetric_fusion.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <stdexcept>

#include "recon/fusion/cell_statistics.hpp"
#include "tests/surface/mesh_checks.hpp"
#include "tests/world/ground.hpp"

namespace fathom::fusion {
namespace {

using test::Footprint, test::rangeMesh;

double rolling(double n, double e) {
  return 2.0 + 0.1 * std::sin(3.0 * n) + 0.08 * std::cos(2.5 * e);
}

const Eigen::Vector3d kAbove(0, 0, 0);

// A sphere's near side as a range mesh: rays of a grid of angles from `centre`, noise along the rays.
Mesh sphereSeenFrom(const Eigen::Vector3d& camera, double radius, double sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, 1.0);
  const double distance = camera.norm();
  const Eigen::Vector3d forward = -camera / distance;
  const Eigen::Vector3d right = forward.unitOrthogonal(), down = forward.cross(right);
  const double widest = 0.98 * std::tan(std::asin(radius / distance));
  constexpr int kSide = 61;
  Mesh mesh;
  std::vector<int> index(kSide * kSide, -1);
  for (int i = 0; i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) {
      const double u = widest * (2.0 * i / (kSide - 1) - 1), v = widest * (2.0 * j / (kSide - 1) - 1);
      if (std::hypot(u, v) > widest) continue;
      const Eigen::Vector3d ray = (forward + u * right + v * down).normalized();
      const double b = camera.dot(ray), c = camera.squaredNorm() - radius * radius;
      const double range = -b - std::sqrt(std::max(0.0, b * b - c)) + sigma * noise(random);
      index[static_cast<std::size_t>(i * kSide + j)] = static_cast<int>(mesh.vertices.size());
      mesh.vertices.push_back((camera + range * ray).cast<float>());
      mesh.sigma.push_back(static_cast<float>(sigma));
    }
  }
  const auto add = [&](int a, int b, int c) {
    if (a >= 0 && b >= 0 && c >= 0)
      mesh.triangles.push_back(
          {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  };
  for (int i = 0; i + 1 < kSide; ++i) {
    for (int j = 0; j + 1 < kSide; ++j) {
      const auto at = [&](int di, int dj) {
        return index[static_cast<std::size_t>((i + di) * kSide + j + dj)];
      };
      add(at(0, 0), at(0, 1), at(1, 1));
      add(at(0, 0), at(1, 1), at(1, 0));
    }
  }
  return mesh;
}

TEST(VolumetricFusion, NothingIntegratedGivesAnEmptyMesh) {
  const VolumetricFusion fusion({});
  EXPECT_TRUE(fusion.extract().vertices.empty());
  EXPECT_TRUE(fusion.extract().triangles.empty());
}

TEST(VolumetricFusion, APlaneIsReproducedFacingTheCameraWithoutHoles) {
  VolumetricFusion fusion({});
  fusion.integrate(rangeMesh({.sigma = 0.0, .colour = {10, 200, 30}}, test::level(2.01), 1), kAbove);
  const Mesh mesh = fusion.extract();
  ASSERT_GT(mesh.triangles.size(), 5000u);
  ASSERT_EQ(mesh.normals.size(), mesh.vertices.size());
  for (const auto& v : mesh.vertices) EXPECT_NEAR(v.z(), 2.01, 1e-4);
  for (const auto& n : mesh.normals) EXPECT_LT(n.z(), -0.999F);
  for (const auto& c : mesh.colours) EXPECT_EQ(c, (Rgb{10, 200, 30}));
  EXPECT_NEAR(test::areaOf(mesh), 4.0, 0.4);  // whole but for a voxel or two at the border
  const test::Topology topology = test::topologyOf(mesh);
  EXPECT_EQ(topology.bad_edges, 0U);
  // One outline and no holes: a disc has Euler characteristic 1.
  EXPECT_EQ(topology.vertices, mesh.vertices.size());
  EXPECT_EQ(topology.euler(), 1);
}

TEST(VolumetricFusion, ErrorsFallWithTheNumberOfViews) {
  std::map<int, double> rms;
  for (const int views : {1, 4, 16}) {
    VolumetricFusion fusion({});
    for (int k = 0; k < views; ++k) {
      const double n = 0.05 * (k % 4 - 1.5), e = 0.05 * (k / 4 - 1.5);
      fusion.integrate(rangeMesh({.north = n, .east = e, .sigma = 0.02}, rolling, static_cast<unsigned>(k)),
                       Eigen::Vector3d(n, e, 0));
    }
    double sum = 0;
    int count = 0;
    for (const auto& v : fusion.extract().vertices) {
      if (v.head<2>().cwiseAbs().maxCoeff() > 0.7F) continue;
      const double error = static_cast<double>(v.z()) - rolling(v.x(), v.y());
      sum += error * error;
      ++count;
    }
    ASSERT_GT(count, 1000);
    rms[views] = std::sqrt(sum / count);
  }
  EXPECT_LT(rms[1], 0.025);
  EXPECT_LT(rms[4], 0.62 * rms[1]);
  EXPECT_LT(rms[16], 0.36 * rms[1]);
}

TEST(VolumetricFusion, ASphereSeenFromAllSidesIsWatertightAndRound) {
  VolumetricFusion fusion({.voxel = 0.02, .truncation = 0.06});
  unsigned seed = 0;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x != 0 || y != 0 || z != 0) {
          const Eigen::Vector3d camera = 2.0 * Eigen::Vector3d(x, y, z).normalized();
          fusion.integrate(sphereSeenFrom(camera, 0.5, 0.004, ++seed), camera);
        }
  const Mesh mesh = fusion.extract();
  EXPECT_EQ(test::topologyOf(mesh).border_edges, 0U);
  EXPECT_EQ(test::topologyOf(mesh).bad_edges, 0U);
  double sum = 0, mean = 0, volume = 0;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const double r = static_cast<double>(mesh.vertices[v].norm()) - 0.5;
    mean += r / static_cast<double>(mesh.vertices.size());
    sum += r * r;
    EXPECT_GT(mesh.normals[v].dot(mesh.vertices[v].normalized()), 0.7F);
  }
  for (const auto& [a, b, c] : mesh.triangles)
    volume += static_cast<double>(mesh.vertices[a].dot(mesh.vertices[b].cross(mesh.vertices[c]))) / 6;
  EXPECT_LT(std::sqrt(sum / static_cast<double>(mesh.vertices.size())), 0.003);
  EXPECT_NEAR(mean, 0.0, 0.001);
  EXPECT_NEAR(volume, 4.0 / 3.0 * M_PI * 0.125, 0.006);
}

TEST(VolumetricFusion, APreciseMeshOutweighsARoughOne) {
  VolumetricFusion fusion({});
  Mesh rough = rangeMesh({.sigma = 0}, test::level(2.06), 1);
  rough.sigma.assign(rough.sigma.size(), 0.06F);
  Mesh precise = rangeMesh({.sigma = 0}, test::level(2.0), 2);
  precise.sigma.assign(precise.sigma.size(), 0.006F);
  fusion.integrate(rough, kAbove);
  fusion.integrate(precise, kAbove);
  for (const auto& v : fusion.extract().vertices)
    if (v.head<2>().cwiseAbs().maxCoeff() < 0.7F) {
      EXPECT_NEAR(v.z(), 2.0, 0.003);
    }
}

TEST(VolumetricFusion, RoughGroundIsKnownBestWhereThePointsAre) {
  // How much less sure the surface is between a mesh's points, 0.1 m apart, than near them.
  const auto ratioOn = [](const std::function<double(double, double)>& ground) {
    const Mesh mesh = rangeMesh({.spacing = 0.1, .sigma = 0.0}, ground, 1);
    VolumetricFusion fusion({.border = 0.01});
    fusion.integrate(mesh, Eigen::Vector3d(0, 0, -20));
    const Mesh fused = fusion.extract();
    double near = 0, far = 0, near_count = 0, far_count = 0;
    for (std::size_t k = 0; k < fused.vertices.size(); ++k) {
      if (fused.vertices[k].head<2>().cwiseAbs().maxCoeff() > 0.8F) continue;
      float distance = INFINITY;
      for (const auto& v : mesh.vertices) distance = std::min(distance, (v - fused.vertices[k]).norm());
      if (distance < 0.02F) {
        near += static_cast<double>(fused.sigma[k]);
        ++near_count;
      } else if (distance > 0.045F) {
        far += static_cast<double>(fused.sigma[k]);
        ++far_count;
      }
    }
    return far / far_count / (near / near_count);
  };
  EXPECT_NEAR(ratioOn([](double, double) { return 2.0; }), 1.0, 0.02);
  EXPECT_GT(ratioOn([](double n, double e) { return 2.0 + 0.04 * std::sin(12 * n) * std::sin(12 * e); }),
            1.5);
}

TEST(VolumetricFusion, AFishIsCarvedByMeshesSeenThroughIt) {
  const auto flat = test::level(2.0);
  VolumetricConfig config;
  for (const bool carve : {false, true}) {
    config.carve = carve;
    VolumetricFusion fusion(config);
    const auto fish = [](double n, double e) { return std::hypot(n, e) < 0.25 ? 1.3 : 2.0; };
    fusion.integrate(rangeMesh({.sigma = 0.01}, fish, 1), kAbove);
    for (unsigned k = 0; k < 3; ++k) fusion.integrate(rangeMesh({.sigma = 0.01}, flat, 10 + k), kAbove);
    double highest = 10;
    int seafloor_below = 0;
    for (const auto& v : fusion.extract().vertices) {
      highest = std::min(highest, static_cast<double>(v.z()));
      if (v.head<2>().norm() < 0.2F && std::abs(v.z() - 2.0F) < 0.03F) ++seafloor_below;
    }
    EXPECT_GT(seafloor_below, 50);
    if (carve) {
      EXPECT_GT(highest, 1.9);
    } else {
      EXPECT_LT(highest, 1.4);
    }
  }
}

TEST(VolumetricFusion, CarvingLeavesWhatOthersSawStanding) {
  // A step: all meshes see the upper level, none through it.
  const auto step = [](double n, double) { return n < 0 ? 1.5 : 2.0; };
  VolumetricFusion fusion({});
  for (unsigned k = 0; k < 5; ++k)
    fusion.integrate(rangeMesh({.sigma = 0.01}, step, k), Eigen::Vector3d(0.1 * k, 0, 0));
  int upper = 0, lower = 0;
  for (const auto& v : fusion.extract().vertices) {
    if (v.x() < -0.1F && std::abs(v.z() - 1.5F) < 0.02F) ++upper;
    if (v.x() > 0.1F && std::abs(v.z() - 2.0F) < 0.02F) ++lower;
  }
  EXPECT_GT(upper, 1200);
  EXPECT_GT(lower, 1200);
}

TEST(VolumetricFusion, MinObservationsKeepsOnlyWhatEnoughMeshesSaw) {
  VolumetricFusion fusion({.min_observations = 2});
  const auto flat = test::level(2.0);
  fusion.integrate(rangeMesh({.north = -0.5}, flat, 1), Eigen::Vector3d(-0.5, 0, 0));
  fusion.integrate(rangeMesh({.north = 0.5}, flat, 2), Eigen::Vector3d(0.5, 0, 0));
  for (const auto& v : fusion.extract().vertices) EXPECT_LT(std::abs(v.x()), 0.58F);
  EXPECT_FALSE(fusion.extract().empty());
}

TEST(VolumetricFusion, TheSameMeshesGiveTheSameBytes) {
  const auto build = [] {
    VolumetricFusion fusion({});
    for (unsigned k = 0; k < 5; ++k)
      fusion.integrate(rangeMesh({.north = 0.4 * k, .sigma = 0.01}, rolling, k),
                       Eigen::Vector3d(0.4 * k, 0, 0));
    return fusion.extract();
  };
  const Mesh a = build(), b = build();
  ASSERT_EQ(a.vertices.size(), b.vertices.size());
  EXPECT_EQ(std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof a.vertices[0]), 0);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.colours, b.colours);
}

TEST(VolumetricFusion, EveryInstructionSetGivesTheSameBytes) {
  const auto fish = [](double n, double e) { return std::hypot(n, e) < 0.2 ? 1.3 : rolling(n, e); };
  VolumetricFusion fastest({}), baseline({.baseline_kernels = true});
  for (VolumetricFusion* fusion : {&fastest, &baseline}) {
    fusion->integrate(rangeMesh({.sigma = 0.01}, fish, 1), kAbove);
    for (unsigned k = 0; k < 4; ++k)
      fusion->integrate(rangeMesh({.north = 0.3 * k, .sigma = 0.01}, rolling, 2 + k),
                        Eigen::Vector3d(0.3 * k, 0.1, 0));
  }
  EXPECT_EQ(fastest.counters().voxel_updates, baseline.counters().voxel_updates);
  EXPECT_EQ(fastest.counters().carved_voxels, baseline.counters().carved_voxels);
  EXPECT_GT(fastest.counters().carved_voxels, 100U);
  const Mesh a = fastest.extract(), b = baseline.extract();
  ASSERT_EQ(a.vertices.size(), b.vertices.size());
  EXPECT_EQ(std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof a.vertices[0]), 0);
  EXPECT_EQ(std::memcmp(a.sigma.data(), b.sigma.data(), a.sigma.size() * sizeof a.sigma[0]), 0);
  EXPECT_EQ(a.colours, b.colours);
}

TEST(VolumetricFusion, EveryVoxelInReachOfAMeshIsSeenOnce) {
  // A level seafloor under a camera far off: all rays are vertical, so the voxels' number follows from
  // the area.
  VolumetricFusion fusion({.carve = false});
  fusion.integrate(rangeMesh({.sigma = 0}, test::level(2.0165), 1), Eigen::Vector3d(0, 0, -5000));
  // 2 m / 33 mm: 61 x 61 columns inside, of six voxels closer than 0.1 m.
  EXPECT_EQ(fusion.counters().voxel_updates, 61U * 61U * 6U);
}

TEST(VolumetricFusion, TheRampWidensWhereMeshesDisagree) {
  // Two passes 0.25 m apart in depth, each sure of itself: a ramp of 0.1 m keeps two surfaces, one as wide as
  // their spread asks for makes one between them.
  VolumetricConfig config{.carve = false};
  const Mesh upper = rangeMesh({.sigma = 0.002}, test::level(2.0), 1);
  const Mesh lower = rangeMesh({.sigma = 0.002}, test::level(2.25), 2);
  CellStatistics statistics;
  statistics.add(upper);
  statistics.add(lower);
  for (const bool known : {false, true}) {
    config.statistics = known ? &statistics : nullptr;
    VolumetricFusion fusion(config);
    fusion.integrate(upper, kAbove);
    fusion.integrate(lower, kAbove);
    std::size_t between = 0, apart = 0;
    for (const auto& v : fusion.extract().vertices) {
      if (v.head<2>().cwiseAbs().maxCoeff() > 0.7F) continue;
      ++(std::abs(v.z() - 2.125F) < 0.1F ? between : apart);
    }
    EXPECT_GT(known ? between : apart, 1000U);
    EXPECT_EQ(known ? apart : between, 0U);
  }
}

TEST(VolumetricFusion, MemoryGrowsWithTheAreaCoveredAndNotWithTheViews) {
  VolumetricFusion fusion({});
  fusion.integrate(rangeMesh({}, rolling, 1), kAbove);
  const std::size_t once = fusion.memoryBytes();
  EXPECT_LT(static_cast<double>(once) / 4.0, 0.5e6);  // bytes a square metre
  for (unsigned k = 0; k < 10; ++k) fusion.integrate(rangeMesh({}, rolling, 2 + k), kAbove);
  EXPECT_LT(fusion.memoryBytes(), once * 13 / 10);
}

TEST(VolumetricFusion, NonsenseInAMeshIsSkippedAndCounted) {
  VolumetricFusion fusion({});
  Mesh mesh = rangeMesh({}, rolling, 1);
  mesh.vertices[100].x() = std::numeric_limits<float>::infinity();
  mesh.vertices[300].z() = 3e7F;
  mesh.vertices[500].y() += 50.0F;
  mesh.sigma[700] = std::numeric_limits<float>::quiet_NaN();
  mesh.triangles.push_back({0, 1, 99'999'999});
  fusion.integrate(mesh, kAbove);
  fusion.integrate(mesh, Eigen::Vector3d(NAN, 0, 0));
  fusion.integrate(Mesh{}, kAbove);
  EXPECT_GE(fusion.counters().skipped_triangles, 18u);
  const Mesh out = fusion.extract();
  EXPECT_FALSE(out.empty());
  for (const auto& v : out.vertices) EXPECT_TRUE(v.allFinite());
}

TEST(VolumetricFusion, AMeshSeenFromBehindIsNotIntegrated) {
  VolumetricFusion fusion({});
  fusion.integrate(rangeMesh({}, rolling, 1), Eigen::Vector3d(0, 0, 5));
  EXPECT_TRUE(fusion.extract().empty());
  EXPECT_GT(fusion.counters().skipped_triangles, 1000u);
}

TEST(VolumetricFusion, AConfigurationOutOfRangeIsRefused) {
  EXPECT_THROW(VolumetricFusion({.voxel = 0}), std::invalid_argument);
  EXPECT_THROW(VolumetricFusion({.voxel = 0.1, .truncation = 0.01}), std::invalid_argument);
  EXPECT_THROW(VolumetricFusion({.min_observations = 0}), std::invalid_argument);
}

}  // namespace
}  // namespace fathom::fusion
