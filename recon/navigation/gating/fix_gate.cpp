#include "recon/navigation/gating/fix_gate.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::slam {
namespace {

constexpr double kAnywhere = 1000;  // standard deviation of a place that nothing fixes [m]
// And what the factor has of it until something does: information that is 1e14 times the least in it would
// leave nothing of that when it is taken out.
constexpr double kGauge = 10;     // [m]
constexpr double kRunSigmas = 3;  // standard deviations between fixes outside the gate that agree
// So long fixes outside the gate that agree with each other are rejected; not so long where no sensor was
// accepted since one was last inside it.
constexpr double kRejected_s = 900, kRejectedUnconfirmed_s = 60;

// Poses turned by more are not left to a solver that descends from where they are [rad].
constexpr double kFarTurned = 0.3;

}  // namespace

void FixMoments::Sums::add(const Eigen::Vector2d& place, double sigma) {
  const double w = 1 / (sigma * sigma);
  weight += w;
  sum += w * place;
  squares += w * place.squaredNorm();
}

Eigen::Vector2d FixMoments::middle(double shared) const {
  const double weight = by_usbl_.weight / (1 + by_usbl_.weight * shared * shared),
               all = alone_.weight + weight;
  return all > 0 ? (alone_.sum + weight * by_usbl_.middle()) / all : alone_.sum;
}

Eigen::Matrix2d FixMoments::errorOf(const Eigen::Vector2d& from_middle, double scale, double direction,
                                    double usbl_turn) const {
  const double seen = by_usbl_.aboutMiddle(), turned = seen / (1 + seen * usbl_turn * usbl_turn);
  const auto left = [](double variance, double information) {
    return variance / (1 + variance * information);
  };
  const Eigen::Vector2d across(-from_middle.y(), from_middle.x());
  return left(scale, alone_.aboutMiddle() + seen) * from_middle * from_middle.transpose() +
         left(direction, alone_.aboutMiddle() + turned) * across * across.transpose();
}

FixGate::FixGate(KeyframeStore& keyframes, const DvlCalibration& dvl, SharedTurns& turns,
                 RobustFactors& robust)
    : keyframes_(keyframes),
      solver_(keyframes.solver()),
      config_(keyframes.config()),
      dvl_(dvl),
      turns_(turns),
      robust_(robust) {}

Eigen::Vector2d FixGate::startingShift() const {
  const double by_usbl = hypotenuse(usbl_anchor_.sigma, usblShift(usbl_anchor_.sigma, config_.noise)),
               weight = 1 / (anchor_.sigma * anchor_.sigma), usbl_weight = 1 / (by_usbl * by_usbl);
  if (!(weight + usbl_weight > 0)) return Eigen::Vector2d::Zero();
  return (weight * anchor_.shift + usbl_weight * usbl_anchor_.shift) / (weight + usbl_weight);
}

double FixGate::anchorSigma() const {
  return std::min(anchor_.sigma, kAnywhere);
}

// The pose of the graph for what all USBL positions share. It never retires.
void FixGate::addUsbl(const Eigen::Vector2d& north_east, double sigma) {
  usbl_.sigma = usblShift(sigma, config_.noise);
  usbl_.T_nav_usbl = SE3(Eigen::Quaterniond::Identity(), {north_east.x(), north_east.y(), 0});
  usbl_.node = keyframes_.addNode(usbl_.T_nav_usbl);
  if (usbl_.node >= 0)
    (void)keyframes_.addFactor(usblFrame(kWorld, usbl_.node, usbl_.T_nav_usbl, sigma, config_.noise));
}

// Something fixes where the first keyframe is.
void FixGate::releaseGauge() {
  if (gauge_ < 0) return;
  (void)solver_.setWeight(gauge_, std::pow(kGauge / anchorSigma(), 2));
  keyframes_.setMustStay(solver_.measurement(gauge_).to, false);
  gauge_ = -1;
}

void FixGate::anchorFirst(const Keyframe& keyframe, const SE3& T_nav_cam) {
  const Eigen::Vector3d& in_odom = keyframe.T_odom_cam.translation();
  const Eigen::Vector2d place = in_odom.head<2>();
  const bool unknown = anchor_.sigma > kGauge && !std::isfinite(usbl_anchor_.sigma);
  const int anchor =
      keyframes_.addFactor(fixFactor(kWorld, keyframe.node, T_nav_cam, keyframe.T_odom_cam, in_odom,
                                     place + anchor_.shift, unknown ? kGauge : anchorSigma()));
  if (unknown) gauge_ = anchor;
  keyframes_.setMustStay(keyframe.node, unknown);
  moments_.add(T_nav_cam.translation().head<2>(), anchorSigma(), false);
  if (!std::isfinite(usbl_anchor_.sigma)) return;
  const Eigen::Vector2d seen = place + usbl_anchor_.shift;
  addUsbl(seen, usbl_anchor_.sigma);
  if (usbl_.node < 0) return;
  (void)keyframes_.addFactor(usblFixFactor(usbl_.node, keyframe.node, usbl_.T_nav_usbl, usbl_.T_nav_usbl,
                                           T_nav_cam, keyframe.T_odom_cam, in_odom, seen,
                                           usbl_anchor_.sigma));
  moments_.add(T_nav_cam.translation().head<2>(), usbl_anchor_.sigma, true);
}

Eigen::Matrix2d FixGate::sharedError(const Eigen::Vector2d& from_held) const {
  const SensorNoise& noise = config_.noise;
  // While the DVL's scale is estimated again from nothing, the images hold the survey.
  constexpr double kMostScale = 0.03;  // of a speed of sound that is not measured [1]
  const Eigen::Vector2d most(kMostScale, noise.dvl_heading);
  const Eigen::Vector2d dvl = dvl_.covariance().diagonal().head<2>().cwiseMin(most.cwiseAbs2());
  return moments_.errorOf(from_held, noise.visual_scale * noise.visual_scale + dvl(0), dvl(1),
                          noise.usbl_turn);
}

Matrix6d FixGate::widened(Matrix6d covariance, const SE3& T_nav_cam, const Eigen::Matrix2d& by) {
  const Eigen::Matrix<double, 2, 3> R = T_nav_cam.matrix3().topRows<2>();
  covariance.topLeftCorner<3, 3>() += R.transpose() * by * R;
  return covariance;
}

UncertainPose FixGate::predict(int a, int b) {
  const int from = keyframes_[a].node, to = keyframes_[b].node;
  const SE3 &T_nav_a = solver_.pose(from), &T_nav_b = solver_.pose(to);
  return {T_nav_a.inverse() * T_nav_b,
          widened(turns_.relativeCovariance(from, to), T_nav_b,
                  sharedError((T_nav_b.translation() - T_nav_a.translation()).head<2>()))};
}

Matrix6d FixGate::covariance(int keyframe) {
  const SE3& T_nav_cam = keyframes_.pose(keyframe);
  Eigen::Matrix2d by = sharedError(T_nav_cam.translation().head<2>() - moments_.middle(usbl_.sigma));
  if (gauge_ >= 0) by.diagonal().array() += std::pow(anchorSigma(), 2) - kGauge * kGauge;
  return widened(turns_.covariance(keyframes_[keyframe].node), T_nav_cam, by);
}

SE3 FixGate::usblCorrection() const {
  if (usbl_.node < 0) return SE3();
  const SE3& now = solver_.pose(usbl_.node);
  return {now.rotation(), now.translation() - usbl_.T_nav_usbl.translation()};
}

// Whether fixes outside the gate have agreed with each other for so long that the graph must be wrong. Single
// outliers differ from each other.
bool FixGate::rejectedAgree(std::int64_t utc_ns, const Eigen::Vector2d& innovation, double sigma) {
  RejectedRun& run = rejected_;
  const bool alike = run.fixes > 0 && (innovation - run.innovation).norm() < kRunSigmas * sigma;
  if (!alike) run = {0, utc_ns, innovation};
  ++run.fixes;
  run.innovation += (innovation - run.innovation) / run.fixes;
  const double rejected_s = unconfirmed_ns_ > accepted_ns_ ? kRejectedUnconfirmed_s : kRejected_s;
  return run.fixes >= config_.reject_after &&
         static_cast<double>(utc_ns - run.since_ns) >= rejected_s * kNanosecondsPerSecond;
}

// Covariance of a fix's innovation [m^2]. Until so many positions of the USBL agree that one outlier cannot
// stand for all, what they share is no better known than before.
Eigen::Matrix2d FixGate::spreadOf(int keyframe, const SE3& T_from_cam, double sigma, bool by_usbl) {
  const bool known = by_usbl && usbl_.fixes >= config_.reject_after;
  const Eigen::Matrix3d R = T_from_cam.matrix3();
  const Eigen::Vector2d place = keyframes_.pose(keyframe).translation().head<2>();
  const Matrix6d covariance = known
                                  ? widened(turns_.relativeCovariance(usbl_.node, keyframes_[keyframe].node),
                                            T_from_cam, sharedError(place - moments_.middleOfUsbl()))
                                  : this->covariance(keyframe);
  const double shared = by_usbl && !known ? usbl_.sigma : 0;
  return config_.known_scale * (R * covariance.topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>() +
         (sigma * sigma + shared * shared) * Eigen::Matrix2d::Identity();
}

Taken FixGate::add(int number, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
                   double sigma, bool by_usbl) {
  NavigationCounters& counters = keyframes_.counters();
  if (!keyframes_.has(number) || !antenna_in_odom.allFinite() || !north_east.allFinite() || !(sigma > 0) ||
      !std::isfinite(sigma)) {
    ++counters.fixes_refused;
    return Taken::kBad;
  }
  if (robust_.isFull()) {
    ++counters.fixes_refused;
    return Taken::kFull;
  }
  if (by_usbl && usbl_.node < 0) {
    addUsbl(north_east, sigma);
    (void)solver_.step();  // takes it into the factor
  }
  const Keyframe& keyframe = keyframes_[number];
  const SE3 T_from = by_usbl ? solver_.pose(usbl_.node) : SE3(), &T_nav_cam = solver_.pose(keyframe.node);
  const RelativePose factor =
      by_usbl ? usblFixFactor(usbl_.node, keyframe.node, usbl_.T_nav_usbl, T_from, T_nav_cam,
                              keyframe.T_odom_cam, antenna_in_odom, north_east, sigma)
              : fixFactor(kWorld, keyframe.node, T_nav_cam, keyframe.T_odom_cam, antenna_in_odom, north_east,
                          sigma);
  const SE3 T_from_cam = T_from.inverse() * T_nav_cam;
  const Eigen::Matrix2d spread = spreadOf(number, T_from_cam, sigma, by_usbl);
  const Eigen::Vector2d innovation = (factor.T_from_to.translation() - T_from_cam.translation()).head<2>();
  bool confirmed = false;
  if (innovation.dot(spread.inverse() * innovation) > config_.fix_gate) {
    ++counters.fixes_gated;
    confirmed = rejectedAgree(keyframe.utc_ns, innovation, sigma);
    if (!confirmed) return Taken::kContradicts;
  } else {
    rejected_ = {};
    accepted_ns_ = keyframe.utc_ns;
  }
  const int measurement = keyframes_.addFactor(factor);
  if (measurement < 0) {
    ++counters.fixes_refused;
    return Taken::kFull;
  }
  releaseGauge();
  robust_.add({factor.from, factor.to, factor.T_from_to, factor.information, measurement, kFixFree, 1, true,
               false, confirmed});
  ++counters.fixes;
  if (by_usbl) ++usbl_.fixes;
  moments_.add(north_east, sigma, by_usbl);
  return Taken::kYes;
}

bool FixGate::rebuildIndices() {
  if (gauge_ != -1 && !keyframes_.isMeasurement(gauge_)) return false;
  if (gauge_ >= 0) keyframes_.setMustStay(solver_.measurement(gauge_).to, true);
  return usbl_.node == -1 ||
         (usbl_.node > 0 && keyframes_.isNode(usbl_.node) && keyframes_.ofNode(usbl_.node) < 0);
}

LinkGate::LinkGate(KeyframeStore& keyframes, DvlCalibration& dvl, SharedTurns& turns, RobustFactors& robust,
                   FixGate& fixes, StepGate& steps, SensorReferences& references)
    : keyframes_(keyframes),
      dvl_(dvl),
      turns_(turns),
      robust_(robust),
      fixes_(fixes),
      steps_(steps),
      references_(references) {
  displaced_.reserve(static_cast<std::size_t>(keyframes.config().max_keyframes));
}

// Whether a closure that contradicts the graph agrees with so many others that did that the graph must be
// wrong: around the cycle a - b - b' - a' two of them and the graph's predictions of the short sides come
// back to where they began.
bool LinkGate::agreesWithRejected(int a, int b, const UncertainPose& link) {
  int agreeing = 1;
  for (const Rejected& other : rejected_) {
    if (!keyframes_.has(other.a) || !keyframes_.has(other.b)) continue;
    if (cycleDistance2(link, fixes_.predict(b, other.b), fixes_.predict(a, other.a), other.link) < kCycleGate)
      ++agreeing;
  }
  rejected_[next_rejected_++ % rejected_.size()] = {a, b, link};
  return agreeing >= keyframes_.config().reject_after;
}

// A vehicle that was lost is found: all that came after the last step without an accepted sensor is moved as
// one body to where the closure has keyframe b; the solver distributes the rest.
void LinkGate::displaceLost(int a, int b, const SE3& T_a_b) {
  const SE3 by = keyframes_.pose(a) * T_a_b * keyframes_.pose(b).inverse();
  const std::span<const int> all = keyframes_.living();
  auto first = std::upper_bound(all.begin(), all.end(), b);
  const auto isWeak = [&](int number) {
    const Keyframe& k = keyframes_[number];
    return k.compass_jumped || (!k.visualAccepted() && (k.dvl_rejected || k.quality.seconds_unlocked > 0));
  };
  while (first != all.begin() && *(first - 1) > a && !isWeak(*(first - 1))) --first;
  if (first == all.begin() || *(first - 1) <= a) return;
  --first;  // where the weak step ends
  displaced_.clear();
  for (auto k = first; k != all.end(); ++k) displaced_.push_back(keyframes_[*k].node);
  keyframes_.solver().displace(displaced_, by);
  // Their references of attitude turn with them.
  displaced_.clear();
  references_.appendAttitudeNodes(keyframes_[*first].utc_ns, displaced_);
  keyframes_.solver().displace(displaced_, SE3(by.rotation(), Eigen::Vector3d::Zero()));
  keyframes_.noteChanges();
}

Taken LinkGate::add(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                    bool confirmed) {
  NavigationCounters& counters = keyframes_.counters();
  const NavigationConfig& config = keyframes_.config();
  if (!keyframes_.has(a) || !keyframes_.has(b) || a == b || !covariance.allFinite()) {
    ++counters.links_refused;
    return Taken::kBad;
  }
  Keyframe& to = keyframes_[b];
  const SE3 T_a_b = dvl_.straightened(seen, to.range);
  const Matrix6d spread = covariance + dvl_.leftOpen(T_a_b, to.range);
  const RelativePose factor = linkFactor(keyframes_[a].node, to.node, T_a_b, spread);
  const bool chain =
      kind == LinkKind::kOdometry && b == a + 1 && b == keyframes_.next() - 1 && steps_.waits();
  if ((!chain && robust_.isFull()) || !factor.information.allFinite()) {
    ++counters.links_refused;
    return Taken::kFull;
  }
  const bool agreed = kind == LinkKind::kAgreed;
  if (!chain && !agreed) {
    const Matrix6d known = fixes_.predict(a, b).covariance;
    const bool fits = keyframes_.distance2(factor, config.known_scale * known + spread) <= config.gate;
    if (!fits) ++counters.links_contradicting;
    if (!fits && !agreesWithRejected(a, b, {T_a_b, spread})) return Taken::kContradicts;
  }
  const SE3 &T_nav_a = keyframes_.pose(a), &T_nav_b = keyframes_.pose(b);
  if (agreed && b > a && T_nav_b.rotation().angularDistance((T_nav_a * T_a_b).rotation()) > kFarTurned)
    displaceLost(a, b, T_a_b);
  const int measurement = keyframes_.addFactor(factor);
  if (measurement < 0) {
    ++counters.links_refused;
    return Taken::kFull;
  }
  ++(kind == LinkKind::kOdometry ? counters.odometry_links : counters.closures);
  if (chain) {
    to.link = measurement;
    turns_.hang(to.node, factor.from, keyframes_.pose(b), turnedBy(T_a_b, to.range));
    steps_.setLink({T_a_b, covariance}, seen, confirmed);
    to.visual_turn = {seen, covariance, turns_.rigEpoch()};
  } else {
    if (!agreed && a < b) turns_.learnFromYaw(a, b, {seen, covariance});
    robust_.add({factor.from, factor.to, T_a_b, spread, measurement, kLinkFree, 1, false, false, agreed,
                 dvl_.curl(), turns_.curlEpoch()});
  }
  return Taken::kYes;
}

}  // namespace fathom::slam
