#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "recon/fusion/volumetric_fusion.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/se3.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::fusion {
namespace {

// Distance of points to a triangle mesh, by a grid of its triangles.
class SurfaceDistance {
 public:
  SurfaceDistance(const Mesh& mesh, float cell) : mesh_(mesh), cell_(cell) {
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      Eigen::Array3f low = corner(t, 0), high = low;
      for (int k = 1; k < 3; ++k) {
        low = low.min(corner(t, k).array());
        high = high.max(corner(t, k).array());
      }
      const Eigen::Array3i a = (low / cell_).floor().cast<int>(), b = (high / cell_).floor().cast<int>();
      for (int x = a.x(); x <= b.x(); ++x)
        for (int y = a.y(); y <= b.y(); ++y)
          for (int z = a.z(); z <= b.z(); ++z) cells_[{x, y, z}].push_back(t);
    }
  }

  // Up to one cell; more than that is one cell.
  float operator()(const Eigen::Vector3f& p) const {
    float best = cell_;
    const Eigen::Array3i at = (p.array() / cell_).floor().cast<int>();
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dz = -1; dz <= 1; ++dz) {
          const auto found = cells_.find({at.x() + dx, at.y() + dy, at.z() + dz});
          if (found == cells_.end()) continue;
          for (const std::size_t t : found->second) best = std::min(best, distance(p, t));
        }
    return best;
  }

 private:
  Eigen::Vector3f corner(std::size_t t, int k) const {
    return mesh_.vertices[mesh_.triangles[t][static_cast<std::size_t>(k)]];
  }
  float distance(const Eigen::Vector3f& p, std::size_t t) const {
    const Eigen::Vector3f a = corner(t, 0), b = corner(t, 1), c = corner(t, 2);
    const Eigen::Vector3f n = (b - a).cross(c - a);
    const float area2 = n.squaredNorm();
    float best = std::min({segment(p, a, b), segment(p, b, c), segment(p, c, a)});
    if (area2 > 0) {
      const bool inside = n.dot((b - a).cross(p - a)) >= 0 && n.dot((c - b).cross(p - b)) >= 0 &&
                          n.dot((a - c).cross(p - c)) >= 0;
      if (inside) best = std::min(best, std::abs(n.dot(p - a)) / std::sqrt(area2));
    }
    return best;
  }
  static float segment(const Eigen::Vector3f& p, const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
    const Eigen::Vector3f d = b - a;
    const float s = d.squaredNorm() > 0 ? std::clamp((p - a).dot(d) / d.squaredNorm(), 0.0F, 1.0F) : 0.0F;
    return (p - a - s * d).norm();
  }

  const Mesh& mesh_;
  float cell_;
  std::map<std::array<int, 3>, std::vector<std::size_t>> cells_;
};

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

  VolumetricConfig config;
  config.voxel = 0.001;
  config.truncation = 0.003;
  config.border = 0.003;
  VolumetricFusion fusion(config);
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
  EXPECT_LT(rms(accuracy), 0.0008);
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
