#include "recon/solver/pose_graph.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::slam {
namespace {

// The representative with w >= 0 of the two that mean the same rotation.
Eigen::Quaterniond positive(const Eigen::Quaterniond& q) {
  return q.w() < 0 ? Eigen::Quaterniond(-q.w(), -q.x(), -q.y(), -q.z()) : q;
}

constexpr std::size_t kPoseNumbers = 7, kInformationNumbers = 21;

// The fields of one line, split at blanks.
class Fields {
 public:
  Fields(std::string_view line, const std::string& file, std::size_t number)
      : rest_(line), file_(file), place_("line " + std::to_string(number)) {}

  [[nodiscard]] std::string_view word() {
    const std::size_t begin = rest_.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return rest_ = {};
    const std::size_t end = std::min(rest_.find_first_of(" \t\r", begin), rest_.size());
    const std::string_view result = rest_.substr(begin, end - begin);
    rest_.remove_prefix(end);
    return result;
  }
  [[nodiscard]] double number() {
    const std::string_view text = word();
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
      refuse(text.empty() ? "ends too soon" : "has '" + std::string(text) + "' where a number is wanted");
    return value;
  }
  [[nodiscard]] std::int64_t id() {
    const std::string_view text = word();
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc() || end != text.data() + text.size() || value < 0)
      refuse("has no whole number from 0 as the name of a pose");
    return value;
  }
  [[nodiscard]] SE3 pose() {
    std::array<double, kPoseNumbers> v{};
    for (double& x : v) x = number();
    const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
    if (!(q.norm() > 1e-6)) refuse("has a quaternion of length zero");
    return {q, {v[0], v[1], v[2]}};
  }
  void finish() {
    if (!word().empty()) refuse("has more numbers than its kind takes");
  }
  [[noreturn]] void refuse(const std::string& why) const { throw InputError(file_, place_, why); }

 private:
  std::string_view rest_;
  const std::string& file_;
  std::string place_;
};

struct NamedEdge {
  std::int64_t from, to;
  RelativePose edge;
  std::size_t line;
};

}  // namespace

Vector6d relativePoseError(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to) {
  const SE3 difference = edge.T_from_to.inverse() * (T_w_from.inverse() * T_w_to);
  Vector6d error;
  error << difference.translation(), positive(difference.rotation()).vec();
  return error;
}

RelativePoseLinear linearize(const RelativePose& edge, const SE3& T_w_from, const SE3& T_w_to) {
  const SE3 between = T_w_from.inverse() * T_w_to;
  const SE3 difference = edge.T_from_to.inverse() * between;
  const Eigen::Quaterniond q = positive(difference.rotation());
  const Eigen::Matrix3d measured = edge.T_from_to.matrix3().transpose();
  RelativePoseLinear l;
  l.error << difference.translation(), q.vec();
  l.by_to.setZero();
  l.by_to.topLeftCorner<3, 3>() = difference.matrix3();
  l.by_to.bottomRightCorner<3, 3>() = 0.5 * (q.w() * Eigen::Matrix3d::Identity() + crossMatrix(q.vec()));
  l.by_from.setZero();
  l.by_from.topLeftCorner<3, 3>() = -measured;
  l.by_from.topRightCorner<3, 3>() = measured * crossMatrix(between.translation());
  l.by_from.bottomRightCorner<3, 3>() =
      -0.5 * (q.w() * Eigen::Matrix3d::Identity() - crossMatrix(q.vec())) * measured;
  return l;
}

bool isPositive(const Matrix6d& information) {
  constexpr double kRounding = 1e-9;  // of the greatest eigenvalue
  if (information.llt().info() == Eigen::Success) return true;
  const Vector6d values = symmetricEigenvalues(information);
  return values(0) >= -kRounding * std::max(0.0, values(5));
}

Matrix6d nearestPositive(const Matrix6d& information) {
  const SymmetricEigen<6> eigen = symmetricEigen(information);
  return eigen.vectors * eigen.values.cwiseMax(0).asDiagonal() * eigen.vectors.transpose();
}

Matrix6d residualInformation(const Matrix6d& of_perturbation) {
  Matrix6d m = 0.5 * (of_perturbation + of_perturbation.transpose());
  m.bottomRows<3>() *= 2;
  m.rightCols<3>() *= 2;
  return m;
}

double chiSquare(const PoseGraph& graph) {
  double sum = 0;
  for (const RelativePose& edge : graph.edges) {
    const Vector6d e = relativePoseError(edge, graph.poses[static_cast<std::size_t>(edge.from)],
                                         graph.poses[static_cast<std::size_t>(edge.to)]);
    sum += e.dot(edge.information * e);
  }
  return sum;
}

PoseGraph parseG2o(std::string_view text, const std::string& name, int* made_positive) {
  if (made_positive != nullptr) *made_positive = 0;
  std::map<std::int64_t, SE3> vertices;
  std::vector<NamedEdge> edges;
  std::size_t number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    Fields fields(text.substr(0, end), name, ++number);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::string_view kind = fields.word();
    if (kind.empty() || kind.front() == '#' || kind == "FIX") continue;
    if (kind == "VERTEX_SE3:QUAT") {
      const std::int64_t id = fields.id();
      if (!vertices.emplace(id, fields.pose()).second)
        fields.refuse("gives pose " + std::to_string(id) + " a second time");
    } else if (kind == "EDGE_SE3:QUAT") {
      NamedEdge e{fields.id(), fields.id(), {}, number};
      if (e.from == e.to) fields.refuse("joins pose " + std::to_string(e.from) + " to itself");
      e.edge.T_from_to = fields.pose();
      for (int r = 0; r < 6; ++r)
        for (int c = r; c < 6; ++c) e.edge.information(r, c) = e.edge.information(c, r) = fields.number();
      if (!isPositive(e.edge.information)) {
        if (made_positive == nullptr)
          fields.refuse(
              "has an information matrix that is not positive semidefinite, by which chi2 has no least "
              "value; "
              "correct it, or take the nearest that is one (--nearest-positive)");
        e.edge.information = nearestPositive(e.edge.information);
        ++*made_positive;
      }
      edges.push_back(e);
    } else {
      fields.refuse("is of kind '" + std::string(kind.substr(0, 40)) +
                    "'; VERTEX_SE3:QUAT and EDGE_SE3:QUAT are read");
    }
    fields.finish();
  }
  if (vertices.empty()) throw InputError(name, "", "holds no VERTEX_SE3:QUAT");

  PoseGraph graph;
  for (const auto& [id, pose] : vertices) {
    graph.ids.push_back(id);
    graph.poses.push_back(pose);
  }
  const auto indexOf = [&](std::int64_t id, std::size_t line) {
    const auto at = std::lower_bound(graph.ids.begin(), graph.ids.end(), id);
    if (at == graph.ids.end() || *at != id)
      throw InputError(name, "line " + std::to_string(line),
                       "names pose " + std::to_string(id) + ", which has no VERTEX_SE3:QUAT");
    return static_cast<int>(at - graph.ids.begin());
  };
  for (NamedEdge& e : edges) {
    e.edge.from = indexOf(e.from, e.line);
    e.edge.to = indexOf(e.to, e.line);
    graph.edges.push_back(e.edge);
  }
  return graph;
}

PoseGraph readG2o(const std::filesystem::path& path, int* made_positive) {
  std::error_code ignored;
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path, ignored))
    throw InputError(path.string(), "", "is absent or cannot be read; give a g2o file");
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return parseG2o(text, path.string(), made_positive);
}

void writeG2o(const std::filesystem::path& path, const PoseGraph& graph) {
  AtomicFile file(path);
  std::array<char, 32> text{};
  const auto put = [&](double v) {
    std::snprintf(text.data(), text.size(), " %.12g", v);
    file.stream() << text.data();
  };
  const auto putPose = [&](const SE3& pose) {
    for (const double v : pose.translation()) put(v);
    for (const double v : pose.rotation().coeffs()) put(v);  // x y z w
  };
  const auto idOf = [&](int i) {
    return graph.ids.empty() ? static_cast<std::int64_t>(i) : graph.ids[static_cast<std::size_t>(i)];
  };
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    file.stream() << "VERTEX_SE3:QUAT " << idOf(static_cast<int>(i));
    putPose(graph.poses[i]);
    file.stream() << '\n';
  }
  for (const RelativePose& e : graph.edges) {
    file.stream() << "EDGE_SE3:QUAT " << idOf(e.from) << ' ' << idOf(e.to);
    putPose(e.T_from_to);
    for (int r = 0; r < 6; ++r)
      for (int c = r; c < 6; ++c) put(e.information(r, c));
    file.stream() << '\n';
  }
  file.commit();
}

}  // namespace fathom::slam
