#include "realtime/onboard/link/mission_progress.hpp"

#include <algorithm>
#include <utility>

namespace fathom::onboard {
namespace {

// Nearest point of the segment a-b, as a fraction of its length.
double project(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  const double length2 = (b - a).squaredNorm();
  return length2 > 0 ? std::clamp((p - a).dot(b - a) / length2, 0.0, 1.0) : 1.0;
}

double distanceTo(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& p) {
  return (a + project(a, b, p) * (b - a) - p).norm();
}

}  // namespace

MissionProgress::MissionProgress(std::vector<Eigen::Vector2d> plan, double acceptance_radius)
    : plan_(std::move(plan)), acceptance_radius_(acceptance_radius) {
  double length = 0;
  for (std::size_t i = 0; i < plan_.size(); ++i) {
    if (i > 0) length += (plan_[i] - plan_[i - 1]).norm();
    length_before_.push_back(length);
  }
}

void MissionProgress::update(const Eigen::Vector2d& north_east) {
  if (plan_.size() < 2) return;
  while (leg_ + 2 < plan_.size()) {
    const bool reached = (north_east - plan_[leg_ + 1]).norm() < acceptance_radius_;
    const bool on_next = distanceTo(plan_[leg_ + 1], plan_[leg_ + 2], north_east) <
                         std::min(acceptance_radius_, distanceTo(plan_[leg_], plan_[leg_ + 1], north_east));
    if (!reached && !on_next) break;
    ++leg_;
  }
  const double s = project(plan_[leg_], plan_[leg_ + 1], north_east);
  travelled_ =
      std::max(travelled_, length_before_[leg_] + s * (length_before_[leg_ + 1] - length_before_[leg_]));
}

std::optional<double> MissionProgress::fraction() const {
  if (plan_.size() < 2 || length_before_.back() <= 0) return std::nullopt;
  return travelled_ / length_before_.back();
}

}  // namespace fathom::onboard
