#include "recon/closure/candidates.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "realtime/base/bytes/state_archive.hpp"
#include "recon/geometry/symmetric_eigen.hpp"

namespace fathom::closure {
namespace {

constexpr double kPi = 3.14159265358979323846;

// Nodes and weights of Gauss-Legendre on [-1, 1], the positive half of 16.
constexpr double kNodes[8] = {0.0950125098376374, 0.2816035507792589, 0.4580167776572274, 0.6178762444026438,
                              0.7554044083550030, 0.8656312023878318, 0.9445750230732326, 0.9894009349916499};
constexpr double kWeights[8] = {0.1894506104550685, 0.1826034150449236, 0.1691565193950025,
                                0.1495959888165767, 0.1246289712555339, 0.0951585116824928,
                                0.0622535239386479, 0.0271524594117541};

double normalCdf(double x) {
  return 0.5 * std::erfc(-x / std::sqrt(2.0));
}

bool less(const Candidate& a, const Candidate& b) {
  return std::make_tuple(a.value(), a.newer, a.older) < std::make_tuple(b.value(), b.newer, b.older);
}

}  // namespace

Footprint footprintOf(const SE3& T_nav_cam, double range, const Camera& camera) {
  const Eigen::Vector3d hit = T_nav_cam * Eigen::Vector3d(0, 0, range);
  return {hit.head<2>(), range * std::sqrt(static_cast<double>(camera.width) * camera.height /
                                           (kPi * camera.fx * camera.fy))};
}

double rangeToLevelGround(const SE3& T_nav_cam, double altitude) {
  constexpr double kMinDown = 0.2;  // cosine from the vertical; flatter, the seafloor is out of range
  return altitude / std::max((T_nav_cam.rotation() * Eigen::Vector3d::UnitZ()).z(), kMinDown);
}

double separationOfOverlap(double share) {
  double low = 0, high = 2;
  constexpr int kHalvings = 50;
  for (int i = 0; i < kHalvings; ++i) {
    const double d = 0.5 * (low + high);
    const double lens = 2 * std::acos(d / 2) - d / 2 * std::sqrt(4 - d * d);
    (lens > share * kPi ? low : high) = d;
  }
  return low;
}

double overlapProbability(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance, double reach) {
  constexpr double kTail = 6;      // standard deviations
  constexpr double kLeast = 1e-6;  // standard deviation of a certain separation [m]
  constexpr int kPanels = 2;
  if (!(reach > 0) || !mean.allFinite() || !covariance.allFinite()) return 0;
  const SymmetricEigen<2> axes = symmetricEigen(covariance);
  const Eigen::Vector2d m = axes.vectors.transpose() * mean;
  const double sy = std::sqrt(std::max(axes.values(0), kLeast * kLeast));  // narrow
  const double sx = std::sqrt(std::max(axes.values(1), kLeast * kLeast));
  if (m.norm() + kTail * sx < reach) return 1;
  if (m.norm() - kTail * sx > reach) return 0;
  const double from = std::max(-reach, m.y() - kTail * sx), to = std::min(reach, m.y() + kTail * sx);
  if (from >= to) return 0;
  const auto density = [&](double x) {
    const double half = std::sqrt(std::max(reach * reach - x * x, 0.0)), u = (x - m.y()) / sx;
    return std::exp(-0.5 * u * u) / (sx * std::sqrt(2 * kPi)) *
           (normalCdf((half - m.x()) / sy) - normalCdf((-half - m.x()) / sy));
  };
  double sum = 0;
  const double width = (to - from) / kPanels;
  for (int panel = 0; panel < kPanels; ++panel) {
    const double middle = from + (panel + 0.5) * width;
    for (int k = 0; k < 8; ++k)
      sum += kWeights[k] * 0.5 * width *
             (density(middle - kNodes[k] * 0.5 * width) + density(middle + kNodes[k] * 0.5 * width));
  }
  return std::clamp(sum, 0.0, 1.0);
}

double expectedInformation(const Eigen::Matrix2d& covariance, double sigma) {
  return 0.5 * std::log((Eigen::Matrix2d::Identity() + covariance / (sigma * sigma)).determinant());
}

Candidate candidateOf(std::uint32_t older, const Footprint& there, std::uint32_t newer, const Footprint& here,
                      const Eigen::Matrix2d& covariance, const CandidateConfig& config, double apart) {
  const double reach = apart * 0.5 * (here.radius + there.radius);
  return {older, newer, overlapProbability(here.centre - there.centre, covariance, reach),
          expectedInformation(covariance, config.sigma_measured)};
}

CandidateQueue::CandidateQueue(const CandidateConfig& config) : config_(config) {
  if (!(config.min_overlap > 0 && config.min_overlap < 1) || !(config.sigma_measured > 0) ||
      config.capacity == 0)
    throw std::invalid_argument(
        "closure candidates: 0 < min_overlap < 1, sigma_measured and capacity above 0");
  waiting_.reserve(config.capacity);
}

void CandidateQueue::push(const Candidate& candidate) {
  const auto place = std::lower_bound(waiting_.begin(), waiting_.end(), candidate, less);
  if (waiting_.size() < config_.capacity) {
    waiting_.insert(place, candidate);
    return;
  }
  ++dropped_;
  if (place == waiting_.begin()) return;
  std::move(waiting_.begin() + 1, place, waiting_.begin());
  *(place - 1) = candidate;
}

bool CandidateQueue::pop(Candidate& candidate) {
  if (waiting_.empty()) return false;
  candidate = waiting_.back();
  waiting_.pop_back();
  return true;
}

void CandidateQueue::save(rt::StateWriter& writer) const {
  writer.bounded(waiting_, config_.capacity);
  writer(dropped_);
}

bool CandidateQueue::load(rt::StateReader& reader, std::size_t frames) {
  reader.bounded(waiting_, config_.capacity);
  reader(dropped_);
  for (const Candidate& c : waiting_)
    reader.require(c.older < c.newer && c.newer < frames && std::isfinite(c.value()),
                   "a candidate that cannot be");
  reader.require(std::is_sorted(waiting_.begin(), waiting_.end(), less), "candidates out of order");
  return reader.ok();
}

}  // namespace fathom::closure
