// Where a control network begins: the scale of parts, and the motion that brings them to what was surveyed.
#include <array>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/topside/localise/control_network.hpp"

namespace fathom::topside {
namespace {

SE3 aligned(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to) {
  Eigen::Matrix3Xd a(3, from.size()), b(3, to.size());
  for (std::size_t k = 0; k < from.size(); ++k) {
    a.col(static_cast<Eigen::Index>(k)) = from[k];
    b.col(static_cast<Eigen::Index>(k)) = to[k];
  }
  const Eigen::Matrix4d T = rigidAlignment(a, b);
  return {Eigen::Matrix3d(T.topLeftCorner<3, 3>()), T.topRightCorner<3, 1>()};
}

// Of three points: the smallest height over the longest side, so far from a line.
double spread(const std::array<Eigen::Vector3d, 3>& p) {
  const double area = (p[1] - p[0]).cross(p[2] - p[0]).norm();
  const double longest = std::max({(p[1] - p[0]).norm(), (p[2] - p[0]).norm(), (p[2] - p[1]).norm()});
  return longest > 0 ? area / (longest * longest) : 0;
}

}  // namespace

double ControlNetwork::scaleAt(std::span<const std::vector<std::uint32_t>> parts,
                               std::span<const SE3> poses) const {
  std::vector<std::pair<double, double>> known;  // length, over what the images have
  for (const std::vector<std::uint32_t>& part : parts) {
    std::vector<bool> of(poses.size(), false);
    for (const std::uint32_t k : part) of[k] = true;
    const auto places = placesAt(poses, of);
    const auto add = [&](std::uint32_t a, std::uint32_t b, double length) {
      if (!places[a] || !places[b] || !(length > 0)) return;
      const double seen = (*places[a] - *places[b]).norm();
      if (seen > 0) known.emplace_back(length, length / seen);
    };
    for (std::uint32_t a = 0; a < control_.points.size(); ++a)
      for (std::uint32_t b = a + 1; b < control_.points.size(); ++b)
        if (holds(a) && holds(b)) add(a, b, (*control_.points[a].place - *control_.points[b].place).norm());
    for (const ControlPoints::Bar& bar : control_.bars)
      if (!bar.check) add(bar.from, bar.to, bar.length);
  }
  double longest = 0;
  for (const auto& [length, ratio] : known) longest = std::max(longest, length);
  std::vector<double> ratios;
  for (const auto& [length, ratio] : known)
    if (length >= 0.5 * longest) ratios.push_back(ratio);
  return median(std::move(ratios), 1.0);
}

std::optional<SE3> ControlNetwork::motionOf(std::span<const std::uint32_t> part, std::span<const SE3> poses,
                                            bool turns) const {
  constexpr double kOffLine = 0.1;   // of three points [1]
  constexpr std::size_t kMost = 30;  // whose threes are tried
  std::vector<bool> of(poses.size(), false);
  for (const std::uint32_t k : part) of[k] = true;
  const auto places = placesAt(poses, of);
  std::vector<Eigen::Vector3d> here, there;
  for (std::uint32_t k = 0; k < places.size(); ++k)
    if (places[k] && holds(k) && here.size() < kMost) {
      here.push_back(*places[k]);
      there.push_back(*control_.points[k].place);
    }
  if (here.empty()) return {};
  std::optional<SE3> best;
  double least = INFINITY;
  for (std::size_t a = 0; a < here.size(); ++a)
    for (std::size_t b = a + 1; b < here.size(); ++b)
      for (std::size_t c = b + 1; c < here.size(); ++c) {
        if (spread({there[a], there[b], there[c]}) < kOffLine) continue;
        const SE3 T = aligned({here[a], here[b], here[c]}, {there[a], there[b], there[c]});
        std::vector<double> off;
        for (std::size_t k = 0; k < here.size(); ++k) off.push_back((T * here[k] - there[k]).norm());
        if (const double usual = median(std::move(off)); usual < least) least = usual, best = T;
      }
  if (best) return best;
  const Eigen::Vector3d shift = there.front() - here.front();
  if (!turns || here.size() == 1) return SE3(Eigen::Quaterniond::Identity(), shift);
  // A second point below each keeps the vertical.
  for (std::size_t k = 0, n = here.size(); k < n; ++k) {
    here.emplace_back(here[k] + Eigen::Vector3d::UnitZ());
    there.emplace_back(there[k] + Eigen::Vector3d::UnitZ());
  }
  return aligned(here, there);
}

}  // namespace fathom::topside
