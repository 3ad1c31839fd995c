#include "tests/bench/link/seafloor_lattice.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/mesh_io.hpp"

namespace fathom::bench {
namespace {

// Vertex colours from the texture image beside the mesh; grey where there is none.
std::vector<Rgb> coloursOf(const Mesh& mesh, const std::filesystem::path& ply) {
  if (!mesh.colours.empty()) return mesh.colours;
  std::vector<Rgb> colours(mesh.vertices.size(), Rgb{128, 128, 128});
  for (const auto& entry : std::filesystem::directory_iterator(ply.parent_path())) {
    if (entry.path().extension() != ".jpg" || !entry.path().stem().string().starts_with(ply.stem().string()))
      continue;
    const cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_REDUCED_COLOR_8);
    if (image.empty() || mesh.texture_coordinates.empty()) continue;
    for (std::size_t v = 0; v < colours.size(); ++v) {
      const Eigen::Vector2f& st = mesh.texture_coordinates[v];
      const int column =
          std::clamp(static_cast<int>(st.x() * static_cast<float>(image.cols)), 0, image.cols - 1);
      const int row =
          std::clamp(static_cast<int>((1 - st.y()) * static_cast<float>(image.rows)), 0, image.rows - 1);
      const auto& bgr = image.at<cv::Vec3b>(row, column);
      colours[v] = {bgr[2], bgr[1], bgr[0]};
    }
  }
  return colours;
}

std::int32_t mirrored(std::int32_t i, std::int32_t n) {
  const std::int32_t period = 2 * n, k = ((i % period) + period) % period;
  return k < n ? k : period - 1 - k;
}

}  // namespace

SeafloorLattice::SeafloorLattice(const std::filesystem::path& ply, double spacing) : spacing_(spacing) {
  const Mesh mesh = readPly(ply);
  if (mesh.empty()) throw InputError(ply.string(), "", "has no triangles");
  const std::vector<Rgb> colours = coloursOf(mesh, ply);
  Eigen::Vector2d low = mesh.vertices[0].head<2>().cast<double>(), high = low;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    low = low.cwiseMin(v.head<2>().cast<double>());
    high = high.cwiseMax(v.head<2>().cast<double>());
  }
  rows_ = static_cast<std::int32_t>((high.x() - low.x()) / spacing) + 1;
  columns_ = static_cast<std::int32_t>((high.y() - low.y()) / spacing) + 1;
  nodes_.resize(static_cast<std::size_t>(rows_) * static_cast<std::size_t>(columns_));
  for (const auto& t : mesh.triangles) {
    std::array<Eigen::Vector2d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = (mesh.vertices[t[k]].head<2>().cast<double>() - low) / spacing;
    Eigen::Matrix2d edges;
    edges << p[1] - p[0], p[2] - p[0];
    if (std::abs(edges.determinant()) < 1e-12) continue;
    const Eigen::Matrix2d inverse = edges.inverse();
    const auto [i0, i1] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [j0, j1] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    for (auto i = static_cast<std::int32_t>(std::ceil(i0)); i <= std::min(std::floor(i1), rows_ - 1.0); ++i)
      for (auto j = static_cast<std::int32_t>(std::ceil(j0)); j <= std::min(std::floor(j1), columns_ - 1.0);
           ++j) {
        const Eigen::Vector2d b = inverse * (Eigen::Vector2d(i, j) - p[0]);
        if (b.x() < -1e-9 || b.y() < -1e-9 || b.sum() > 1 + 1e-9) continue;
        const std::array<float, 3> w = {static_cast<float>(1 - b.sum()), static_cast<float>(b.x()),
                                        static_cast<float>(b.y())};
        const float z =
            w[0] * mesh.vertices[t[0]].z() + w[1] * mesh.vertices[t[1]].z() + w[2] * mesh.vertices[t[2]].z();
        Node& node = nodes_[static_cast<std::size_t>(i) * static_cast<std::size_t>(columns_) +
                            static_cast<std::size_t>(j)];
        if (z >= node.depth) continue;
        node.depth = z;
        for (std::size_t c = 0; c < 3; ++c)
          node.colour[c] = static_cast<std::uint8_t>(std::clamp(
              w[0] * static_cast<float>(colours[t[0]][c]) + w[1] * static_cast<float>(colours[t[1]][c]) +
                  w[2] * static_cast<float>(colours[t[2]][c]) + 0.5F,
              0.0F, 255.0F));
      }
  }
}

const SeafloorLattice::Node& SeafloorLattice::at(std::int32_t i, std::int32_t j) const {
  return nodes_[static_cast<std::size_t>(mirrored(i, rows_)) * static_cast<std::size_t>(columns_) +
                static_cast<std::size_t>(mirrored(j, columns_))];
}

}  // namespace fathom::bench
