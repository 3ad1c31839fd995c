#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/geometry/se3.hpp"
#include "tests/fusion/surface_distance.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::fusion {
namespace {

using test::SurfaceDistance;

// A Cyberware range grid: num_cols x num_rows places, each empty or a vertex. Neighbours further apart than
// `longest` [m] are not joined.
Mesh readRangeGrid(const std::filesystem::path& path, float longest) {
  std::ifstream in(path);
  std::string word, line;
  std::size_t columns = 0, rows = 0, vertices = 0;
  while (std::getline(in, line)) {
    std::istringstream fields(line);
    fields >> word;
    if (word == "end_header") break;
    std::string name;
    fields >> name;
    if (name == "num_cols") fields >> columns;
    if (name == "num_rows") fields >> rows;
    if (word == "element" && name == "vertex") fields >> vertices;
  }
  Mesh mesh;
  for (std::size_t v = 0; v < vertices; ++v) {
    Eigen::Vector3f p;
    in >> p.x() >> p.y() >> p.z();
    mesh.vertices.push_back(p);
  }
  std::vector<int> grid(columns * rows, -1);
  for (int& place : grid) {
    int count = 0;
    in >> count;
    if (count > 0) in >> place;
  }
  mesh.sigma.assign(mesh.vertices.size(), 0.0003F);
  const auto near = [&](int a, int b) {
    return (mesh.vertices[static_cast<std::size_t>(a)] - mesh.vertices[static_cast<std::size_t>(b)]).norm() <
           longest;
  };
  const auto add = [&](int a, int b, int c) {
    if (a >= 0 && b >= 0 && c >= 0 && near(a, b) && near(b, c) && near(c, a))
      mesh.triangles.push_back(
          {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  };
  for (std::size_t r = 0; r + 1 < rows; ++r) {
    for (std::size_t c = 0; c + 1 < columns; ++c) {
      const int a = grid[r * columns + c], b = grid[r * columns + c + 1];
      const int d = grid[(r + 1) * columns + c], e = grid[(r + 1) * columns + c + 1];
      add(a, b, e);
      add(a, e, d);
    }
  }
  // The scanner looks along -z: normals towards it.
  double up = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    up += static_cast<double>(
        (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).z());
  if (up < 0)
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

TEST(RangeScans, TenScansOfTheBunnyGiveTheReferenceSurface) {
  FATHOM_REQUIRE_DATA("range_scans/bunny_range_scans.tar.xz");
  const test::TemporaryFolder folder;
  const std::string command = "tar xf '" + test::dataFile("range_scans/bunny_range_scans.tar.xz").string() +
                              "' -C '" + folder.path().string() + "'";
  ASSERT_EQ(std::system(command.c_str()), 0);

  VolumetricFusion fusion({.voxel = 0.001, .truncation = 0.003, .border = 0.003});
  std::ifstream list(folder.path() / "data" / "bun.conf");
  std::string line;
  int scans = 0;
  while (std::getline(list, line)) {
    std::istringstream fields(line);
    std::string kind, name;
    Eigen::Vector3d t;
    Eigen::Quaterniond q;
    if (!(fields >> kind >> name >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w())) continue;
    if (kind != "bmesh") continue;
    Mesh scan = readRangeGrid(folder.path() / "data" / name, 0.003F);
    ASSERT_GT(scan.triangles.size(), 5000u) << name;
    const SE3 T_world_scan(q.conjugate(), t);
    transform(scan, T_world_scan);
    // Parallel lines of sight along z: from far away.
    fusion.integrate(scan, T_world_scan * Eigen::Vector3d(0, 0, 20));
    ++scans;
  }
  ASSERT_EQ(scans, 10);

  const Mesh fused = fusion.extract();
  const Mesh reference = readPly(test::dataFile("range_scans/bun_zipper_res2.ply"));
  const auto distances = [](const Mesh& from, const Mesh& to) {
    const SurfaceDistance toSurface(to, 0.005F);
    std::vector<float> out;
    for (const auto& v : from.vertices) out.push_back(toSurface(v));
    std::sort(out.begin(), out.end());
    return out;
  };
  const auto rms = [](const std::vector<float>& d) {
    double sum = 0;
    for (const float x : d) sum += static_cast<double>(x) * static_cast<double>(x);
    return std::sqrt(sum / static_cast<double>(d.size()));
  };
  const std::vector<float> accuracy = distances(fused, reference), completeness = distances(reference, fused);
  std::printf(
      "fused %zu vertices; accuracy rms %.3f mm, median %.3f, 95 %% %.3f; completeness rms %.3f mm, 95 %% "
      "%.3f; %.1f MB\n",
      fused.vertices.size(), 1e3 * rms(accuracy), 1e3 * static_cast<double>(accuracy[accuracy.size() / 2]),
      1e3 * static_cast<double>(accuracy[accuracy.size() * 95 / 100]), 1e3 * rms(completeness),
      1e3 * static_cast<double>(completeness[completeness.size() * 95 / 100]),
      static_cast<double>(fusion.memoryBytes()) / 1e6);
  // The reference has 2 mm triangles and is itself made from the same scans by zippering.
  EXPECT_LT(accuracy[accuracy.size() / 2], 0.0003F);
  EXPECT_LT(rms(accuracy), 0.0005);
  EXPECT_LT(completeness[completeness.size() * 95 / 100], 0.0010F);
  // Triangles face outwards: the volume is positive, and near the reference's (open below).
  const auto volume = [](const Mesh& mesh) {
    double sum = 0;
    for (const auto& [a, b, c] : mesh.triangles)
      sum += mesh.vertices[a].cast<double>().dot(
                 mesh.vertices[b].cast<double>().cross(mesh.vertices[c].cast<double>())) /
             6;
    return sum;
  };
  EXPECT_NEAR(volume(fused) / volume(reference), 1.0, 0.05);
}

}  // namespace
}  // namespace fathom::fusion
