// Gates of links and fixes, and their robust weights.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {
namespace {

constexpr double kOffAt = 2;         // times what chance explains: a factor is switched off
constexpr double kSettled = 0.01;    // share of chi2 that poses at rest may still lose
constexpr double kNewWeight = 0.15;  // relative change of a weight that is worth the solver's work
constexpr double kAlike = 3;         // standard deviations between wild fixes that agree
// So long fixes outside the gate that agree with each other are rejected: a USBL that is turned or biased by
// a reflection stays so for minutes. Not so long where no sensor was accepted since they last fitted.
constexpr double kDoubted_s = 900, kDoubtedInTrouble_s = 60;
constexpr double kFarTurned =
    0.3;  // poses turned by more are not left to a solver that follows the slope [rad]
constexpr double kNanoseconds = 1e9;

}  // namespace

// Whether a closure that contradicts the graph agrees with so many others that did that the graph must be
// wrong: around the cycle a - b - b' - a' two of them and what the graph knows of the short sides come back
// to where they began.
bool NavigationGraph::agreesWithRefused(int a, int b, const SE3& T_a_b, const Matrix6d& covariance) {
  int agreeing = 1;
  for (const Refused& other : refused_) {
    if (!has(other.a) || !has(other.b)) continue;
    if (cycleDistance2({T_a_b, covariance}, predict(b, other.b), predict(a, other.a), other.link) <
        kCycleGate)
      ++agreeing;
  }
  refused_[next_refused_++ % refused_.size()] = {a, b, {T_a_b, covariance}};
  return agreeing >= config_.lying_after;
}

// A vehicle that was lost is found: all that came after the last step of which nothing certain is known is
// moved as one body to where the closure has keyframe b; the solver shares out what is left.
void NavigationGraph::moveAstray(int a, int b, const SE3& T_a_b) {
  const SE3 by = pose(a) * T_a_b * pose(b).inverse();
  const std::span<const int> all = living();
  auto first = std::upper_bound(all.begin(), all.end(), b);
  const auto weak = [&](int k) {
    const Frame& f = frames_[at(k)];
    const bool seen = f.link >= 0 && !f.visualLies();
    return f.leapt || (!seen && (f.dvl_lies || f.quality.seconds_unlocked > 0));
  };
  while (first != all.begin() && *(first - 1) > a && !weak(*(first - 1))) --first;
  if (first == all.begin() || *(first - 1) <= a) return;
  --first;  // what the weak step leads to
  astray_.clear();
  for (auto k = first; k != all.end(); ++k) astray_.push_back(frames_[at(*k)].node);
  solver_.displace(astray_, by);
  // Their references of attitude turn with them.
  astray_.clear();
  for (const Reference& r : references_)
    if (!r.of_depth && r.utc_ns >= frames_[at(*first)].utc_ns) astray_.push_back(r.node);
  solver_.displace(astray_, SE3(by.rotation(), Eigen::Vector3d::Zero()));
  noteChanges();
}

Taken NavigationGraph::addLink(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                               bool confirmed) {
  if (!has(a) || !has(b) || a == b || !covariance.allFinite()) {
    ++counters_.links_refused;
    return Taken::kBad;
  }
  Frame& to = frames_[at(b)];
  const SE3 T_a_b = dvl_.straightened(seen, to.range);
  const Matrix6d spread = covariance + dvl_.leftOpen(T_a_b, to.range);
  const RelativePose factor = linkFactor(frames_[at(a)].node, to.node, T_a_b, spread);
  const bool chain = kind == LinkKind::kOdometry && b == a + 1 && b == keyframes() - 1 && seen_.waits;
  if ((!chain && robust_.size() == robust_.capacity()) || !factor.information.allFinite()) {
    ++counters_.links_refused;
    return Taken::kFull;
  }
  const bool agreed = kind == LinkKind::kAgreed;
  Prediction known;
  if (!chain && !agreed) {
    known = predict(a, b);
    const bool fits = distance2(factor, config_.known_scale * known.covariance + spread) <= config_.gate;
    if (!fits) ++counters_.links_contradicting;
    if (!fits && !agreesWithRefused(a, b, T_a_b, spread)) return Taken::kContradicts;
  }
  if (agreed && b > a && pose(b).rotation().angularDistance((pose(a) * T_a_b).rotation()) > kFarTurned)
    moveAstray(a, b, T_a_b);
  const int measurement = addFactor(factor);
  if (measurement < 0) {
    ++counters_.links_refused;
    return Taken::kFull;
  }
  ++(kind == LinkKind::kOdometry ? counters_.odometry_links : counters_.closures);
  if (chain) {
    to.link = measurement;
    shared_.hang(to.node, factor.from, solver_.pose(to.node), turnedBy(T_a_b, to.range));
    seen_.linked = true;
    seen_.confirmed = confirmed;
    seen_.link = {T_a_b, covariance};
    seen_.T_a_b = seen;
    to.seen = {seen, covariance, rig_};
  } else {
    if (!agreed && a < b) learnTurn(a, b, {seen, covariance});
    robust_of_[at(measurement)] = static_cast<int>(robust_.size());
    robust_.push_back({factor.from, factor.to, T_a_b, spread, measurement, kLinkFree, 1, false, false, agreed,
                       dvl_.curl(), curved_});
  }
  return Taken::kYes;
}

// Whether fixes outside the gate have agreed with each other for so long that the graph must be wrong. Wild
// fixes differ from each other.
bool NavigationGraph::insists(std::int64_t utc_ns, const Eigen::Vector2d& innovation, double sigma) {
  Insistence& run = insistence_;
  const bool alike = run.fixes > 0 && (innovation - run.innovation).norm() < kAlike * sigma;
  if (!alike) run = {0, utc_ns, innovation};
  ++run.fixes;
  run.innovation += (innovation - run.innovation) / run.fixes;
  const double doubted = trouble_ns_ > fix_agreed_ns_ ? kDoubtedInTrouble_s : kDoubted_s;
  return run.fixes >= config_.lying_after &&
         static_cast<double>(utc_ns - run.since_ns) >= doubted * kNanoseconds;
}

Taken NavigationGraph::addFix(int keyframe, const Eigen::Vector3d& antenna_in_odom,
                              const Eigen::Vector2d& north_east, double sigma, bool by_usbl) {
  if (!has(keyframe) || !antenna_in_odom.allFinite() || !north_east.allFinite() || !(sigma > 0) ||
      !std::isfinite(sigma)) {
    ++counters_.fixes_refused;
    return Taken::kBad;
  }
  const Frame& frame = frames_[at(keyframe)];
  if (robust_.size() == robust_.capacity()) {
    ++counters_.fixes_refused;
    return Taken::kFull;
  }
  if (by_usbl && usbl_.node < 0) {
    addUsbl(north_east, sigma);
    (void)solver_.step();  // takes it into the factor
  }
  // Until so many positions of the USBL agree that one wild one cannot stand for all, what they share is no
  // better known than before.
  const bool known = by_usbl && usbl_.fixes >= config_.lying_after;
  const SE3 T_from = by_usbl ? solver_.pose(usbl_.node) : SE3(), &T_nav_cam = solver_.pose(frame.node);
  const RelativePose factor =
      by_usbl
          ? usblFixFactor(usbl_.node, frame.node, usbl_.T_nav_usbl, T_from, T_nav_cam, frame.T_odom_cam,
                          antenna_in_odom, north_east, sigma)
          : fixFactor(kWorld, frame.node, T_nav_cam, frame.T_odom_cam, antenna_in_odom, north_east, sigma);
  const SE3 T_from_cam = T_from.inverse() * T_nav_cam;
  const Eigen::Matrix3d R = T_from_cam.matrix3();
  const Eigen::Vector2d place = T_nav_cam.translation().head<2>();
  const Matrix6d covariance = known ? widened(relativeCovariance(usbl_.node, frame.node), T_from_cam,
                                              sharedError(place - held_.middleOfUsbl()))
                                    : this->covariance(keyframe);
  const double shared = by_usbl && !known ? usbl_.sigma : 0;
  const Eigen::Matrix2d spread =
      config_.known_scale * (R * covariance.topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>() +
      (sigma * sigma + shared * shared) * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d innovation = (factor.T_from_to.translation() - T_from_cam.translation()).head<2>();
  bool insisted = false;
  if (innovation.dot(spread.inverse() * innovation) > config_.fix_gate) {
    ++counters_.fixes_gated;
    insisted = insists(frame.utc_ns, innovation, sigma);
    if (!insisted) return Taken::kContradicts;
  } else {
    insistence_ = {};
    fix_agreed_ns_ = frame.utc_ns;
  }
  const int measurement = addFactor(factor);
  if (measurement < 0) {
    ++counters_.fixes_refused;
    return Taken::kFull;
  }
  releaseGauge();
  robust_of_[at(measurement)] = static_cast<int>(robust_.size());
  robust_.push_back({factor.from, factor.to, factor.T_from_to, factor.information, measurement, kFixFree, 1,
                     true, false, insisted});
  ++counters_.fixes;
  if (by_usbl) ++usbl_.fixes;
  held_.add(north_east, sigma, by_usbl);
  return Taken::kYes;
}

// Robust weights of the newest factors and of some older ones in turn. A factor is switched off only by poses
// that have come to rest, and on again when it is as likely as a new one must be.
void NavigationGraph::reweight(bool settled) {
  if (robust_.empty()) return;
  const auto look = [&](Robust& r) {
    straightenAnew(r);
    if (r.insists) return;
    const RelativePose factor = r.factor();
    const SE3 from = r.from == kWorld ? SE3() : solver_.pose(r.from);
    const Vector6d e = relativePoseError(factor, from, solver_.pose(r.to));
    const double chi2 = e.dot(factor.information * e);
    const bool off = r.off ? !(fits(r) && settled) : settled && !(chi2 <= kOffAt * r.free_chi2);
    std::uint64_t& offs = r.fix ? counters_.fixes_off : counters_.links_off;
    if (off && !r.off) ++offs;
    if (!off && r.off) --offs;
    const double wanted = off ? 0 : cauchyWeight(chi2, r.free_chi2);
    if (off != r.off || std::abs(wanted - r.weight) > kNewWeight * r.weight) {
      (void)solver_.setWeight(r.measurement, wanted);
      r.weight = wanted;
    }
    r.off = off;
  };
  int left = config_.reweighted;
  for (; newest_robust_ < robust_.size() && left > 0; ++newest_robust_, --left) look(robust_[newest_robust_]);
  for (; left > 0; --left) {
    look(robust_[next_robust_]);
    next_robust_ = (next_robust_ + 1) % robust_.size();
  }
}

// Whether a factor that is switched off agrees with what the rest says.
bool NavigationGraph::fits(const Robust& r) {
  if (r.fix) {
    const SE3 from = r.from == kWorld ? SE3() : solver_.pose(r.from);
    const Vector6d e = relativePoseError(r.factor(), from, solver_.pose(r.to));
    return e.dot(r.spread * e) <= r.free_chi2;
  }
  const Matrix6d known = relativeCovariance(r.from, r.to);
  return distance2(r.factor(), config_.known_scale * known + r.spread) <= config_.gate;
}

StepReport NavigationGraph::step() {
  judge();
  const StepReport report = solver_.step();
  followShared();
  reweight(report.decrease_expected <= kSettled * (1 + report.chi2) && !report.waits_for_factor);
  noteChanges();
  return report;
}

}  // namespace fathom::slam
