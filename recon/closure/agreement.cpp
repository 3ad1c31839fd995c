#include "recon/closure/agreement.hpp"

#include <algorithm>
#include <cstdlib>

namespace fathom::closure {
namespace {

bool agree(const Claim& x, const Claim& y, const RelativePrior& side, const RelativePrior& far_side) {
  return cycleDistance2({x.T_a_b, x.covariance}, far_side, side, {y.T_a_b, y.covariance}) < kCycleGate;
}

}  // namespace

Agreement::Agreement() {
  waiting_.reserve(kWaiting + 1);
  agreed_.reserve(kWaiting + 1);
}

// Takes a claim into agreed_ if it goes with all that are there.
bool Agreement::join(const Claim& claim, const Odometry& odometry) {
  for (const Claim& other : agreed_) {
    const int da = std::abs(other.a - claim.a), db = std::abs(other.b - claim.b);
    if (da + db == 0 || da > kNeighbours || db > kNeighbours) return false;
    if (!agree(claim, other, odometry(claim.a, other.a), odometry(claim.b, other.b))) return false;
  }
  agreed_.push_back(claim);
  return true;
}

std::span<const Claim> Agreement::add(const Claim& claim, const Odometry& odometry) {
  agreed_.assign(1, claim);
  for (std::size_t i = waiting_.size(); i-- > 0;) (void)join(waiting_[i], odometry);
  int wanted = 0;
  bool many_a = false, many_b = false;
  double baseline = 0, span_a = 0, span_b = 0;
  for (const Claim& x : agreed_) {
    wanted = std::max(wanted, x.wanted);
    baseline = std::max(baseline, x.baseline);
    for (const Claim& y : agreed_) {
      if (&x == &y) break;
      many_a = many_a || x.a != y.a;
      many_b = many_b || x.b != y.b;
      span_a = std::max(span_a, odometry(x.a, y.a).T_a_b.translation().norm());
      span_b = std::max(span_b, odometry(x.b, y.b).T_a_b.translation().norm());
    }
  }
  const bool spans = many_a && many_b && std::min(span_a, span_b) >= baseline;
  if (static_cast<int>(agreed_.size()) < wanted || !spans) {
    if (waiting_.size() == kWaiting) {
      waiting_.erase(waiting_.begin());
      ++forgotten_;
    }
    waiting_.push_back(claim);
    return {};
  }
  std::reverse(agreed_.begin(), agreed_.end());
  std::erase_if(waiting_, [&](const Claim& w) {
    return std::any_of(agreed_.begin(), agreed_.end(),
                       [&](const Claim& x) { return x.a == w.a && x.b == w.b; });
  });
  return agreed_;
}

void Agreement::remove(int frame) {
  std::erase_if(waiting_, [&](const Claim& w) { return w.a == frame || w.b == frame; });
}

}  // namespace fathom::closure
