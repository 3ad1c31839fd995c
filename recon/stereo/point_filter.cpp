#include "recon/stereo/point_filter.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "recon/stereo/delaunay.hpp"

namespace fathom::stereo {
namespace {

constexpr std::size_t kLeastNeighbours = 4;
constexpr double kFarthest = 3;        // from the prediction [standard deviations]; beyond is another surface
constexpr double kLeastSpread = 1e-9;  // of the neighbours' rays; with less they are on a line
constexpr double kNotPredicted = -1;

struct FilterNode {
  double x, y;                                        // of the ray, at depth 1
  double inverse_depth;                               // [1/m]
  double variance;                                    // of the inverse depth
  double predicted = 0, uncertainty = kNotPredicted;  // by the neighbours, and its variance
};

std::vector<FilterNode> nodesOf(const StereoResult& result) {
  std::vector<FilterNode> nodes;
  for (const StereoPoint& p : result.points) {
    const Eigen::Vector3d at = p.point.cast<double>();
    const double sigma = static_cast<double>(p.sigma_z) / (at.z() * at.z());
    nodes.push_back({at.x() / at.z(), at.y() / at.z(), 1 / at.z(), sigma * sigma});
  }
  return nodes;
}

void predict(const std::vector<FilterNode>& nodes, std::span<const std::uint32_t> neighbours,
             FilterNode& own) {
  if (neighbours.size() < kLeastNeighbours) return;
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  Eigen::Vector3d sums = Eigen::Vector3d::Zero();
  for (const std::uint32_t k : neighbours) {
    const FilterNode& node = nodes[k];
    const Eigen::Vector3d row(1, node.x - own.x, node.y - own.y);
    squares += row * row.transpose() / node.variance;
    sums += row * (node.inverse_depth / node.variance);
  }
  if (!(squares.determinant() > kLeastSpread * squares.diagonal().prod())) return;
  const Eigen::RowVector3d weights = squares.inverse().row(0);
  own.predicted = weights.dot(sums), own.uncertainty = weights[0];
}

// Over each predicted point and its predicted neighbours.
std::vector<double> averaged(const std::vector<double>& values, const std::vector<FilterNode>& nodes,
                             const TriangleLinks& links) {
  std::vector<double> out(values.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    double sum = 0;
    int count = 0;
    const auto add = [&](std::size_t k) {
      if (nodes[k].uncertainty >= 0) sum += values[k], ++count;
    };
    add(i);
    for (const std::uint32_t k : links.neighbours(i)) add(k);
    if (count > 0) out[i] = sum / count;
  }
  return out;
}

}  // namespace

void smoothPoints(StereoResult& result) {
  TriangleLinks links(result.points.size());
  links.build(result.points.size(), result.triangles);
  std::vector<FilterNode> nodes = nodesOf(result);
  std::vector<double> relief(nodes.size());  // in variances of a point's difference from its prediction
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    FilterNode& n = nodes[i];
    predict(nodes, links.neighbours(i), n);
    const double off = n.inverse_depth - n.predicted;
    relief[i] = off * off / (n.variance + n.uncertainty) - 1;
  }
  relief = averaged(averaged(relief, nodes, links), nodes, links);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const FilterNode& n = nodes[i];
    if (n.uncertainty < 0) continue;
    const double surface = n.uncertainty + std::max(relief[i], 0.0) * (n.variance + n.uncertainty);
    const double off = n.predicted - n.inverse_depth, both = n.variance + surface;
    if (off * off > kFarthest * kFarthest * both) continue;
    StereoPoint& p = result.points[i];
    const auto left = static_cast<float>(surface / both);
    p.point *= static_cast<float>(n.inverse_depth / (n.inverse_depth + off * n.variance / both));
    p.sigma_z *= std::sqrt(left);
    for (float& c : p.covariance) c *= left;
  }
}

}  // namespace fathom::stereo
