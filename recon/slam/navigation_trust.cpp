// Who is believed: the weights of all that may lie.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {
namespace {

constexpr double kOffAt = 2;         // times what chance explains: a factor is switched off
constexpr double kSettled = 0.01;    // share of chi2 that poses at rest may still lose
constexpr double kNewWeight = 0.15;  // relative change of a weight that is worth the solver's work
// Of what is not believed but must hold two parts together, or tells tilt besides heading: its standard
// deviations are a hundred times as large, half a metre and ten degrees.
constexpr double kWidened = 1e-4;
constexpr double kYawUnjudged = 1.0;  // variance of a step's yaw where HeadingTrust judges it [rad^2]
// Share of a turn by which a step's way is turned in the mean: the compass may have leapt at any time of it.
constexpr double kMeanTurn = 0.5;
// A velocity that differs from the one before by twice as much as the other, and this, is the one that lies.
constexpr double kTwice = 2, kLeastChange = 0.05;  // [1], [m/s]
constexpr double kStaleVelocity_s = 10;            // older, it tells nothing of the present one
constexpr double kAlike = 3;                       // standard deviations between wild fixes that agree
// So long fixes that agree with each other are doubted: a USBL that is turned or biased by a reflection stays
// so for minutes. Not so long where the vehicle has gone without anything to be believed since they last
// fitted.
constexpr double kDoubted_s = 900, kDoubtedInTrouble_s = 60;
constexpr double kFarTurned =
    0.3;  // poses turned by more are not left to a solver that follows the slope [rad]
constexpr double kNanoseconds = 1e9;

// Error of a factor as a right perturbation (rho, phi).
Vector6d perturbationOf(const RelativePose& factor, const SE3& T_from, const SE3& T_to) {
  Vector6d e = relativePoseError(factor, T_from, T_to);
  e.tail<3>() *= 2;
  return e;
}

// A way in odom's axes, level, ahead and to starboard of a heading [m].
Eigen::Vector2d level(const Eigen::Vector3d& way, double heading) {
  return Eigen::Rotation2Dd(-heading) * Eigen::Vector2d(way.head<2>());
}

}  // namespace

double NavigationGraph::distance2(const RelativePose& factor, const Matrix6d& covariance) const {
  const Vector6d e = perturbationOf(factor, solver_.pose(factor.from), solver_.pose(factor.to));
  return e.dot(covariance.ldlt().solve(e));
}

// The weights of a step's chain: what is believed has 1; of step and link one stays, widened at least.
void NavigationGraph::weigh(Frame& f) {
  const bool visual = f.link >= 0 && !f.visualLies(), dvl = f.step >= 0 && !f.dvl_lies,
             compass = f.heading.compass && !f.mixed;
  const auto set = [&](int measurement, double weight) {
    if (measurement >= 0 && solver_.measurement(measurement).weight != weight)
      (void)solver_.setWeight(measurement, weight);
  };
  set(f.step, dvl ? f.step_weight : visual ? 0 : kWidened);
  const bool joined = dvl && f.quality.seconds_unlocked == 0;
  set(f.link, visual ? 1 : joined ? 0 : kWidened);
  set(f.attitude, compass ? 1 : kWidened);
  const auto count = [](std::uint64_t& counter, bool& counted, bool lies) {
    counter += lies ? 1U : 0U;
    counter -= counted ? 1U : 0U;
    counted = lies;
  };
  count(counters_.compass_distrusted, f.counted[0], f.attitude >= 0 && !compass);
  count(counters_.visual_distrusted, f.counted[1], f.visualLies());
  count(counters_.steps_left_out, f.counted[2], f.dvl_lies);
}

StepTurns NavigationGraph::turnsOf(const Frame& from, const Frame& to) const {
  StepTurns turns;
  const double before = headingOf(from.T_odom_cam);
  turns.seconds = to.quality.seconds;
  turns.compass = wrapAngle(headingOf(to.T_odom_cam) - before);
  turns.compass_held = to.attitude < 0;
  turns.compass_leapt = to.leapt;
  turns.has_gyro = to.ungyro_s == 0;
  turns.gyro = to.gyro_turn;
  turns.gyro_sigma = config_.noise.gyro_walk * std::sqrt(std::max(turns.seconds, 0.0));
  turns.has_visual = seen_.linked;
  if (seen_.linked) {
    const SE3 seen = from.T_odom_cam * seen_.link.T_a_b;
    turns.visual = wrapAngle(headingOf(seen) - before);
    turns.vouched = to.quality.seconds_unlocked == 0 &&
                    linkFitsButForYaw(from, to, wrapAngle(turns.visual - turns.compass));
    const Eigen::Vector3d down = seen.rotation().conjugate() * Eigen::Vector3d::UnitZ();
    turns.visual_sigma =
        std::sqrt(std::max(0.0, down.dot(seen_.link.covariance.bottomRightCorner<3, 3>() * down)));
  }
  return turns;
}

// Visual odometry against the DVL's step, but for yaw: its own noise, with the tilt's and depth sensor's of
// both ends. Ways are those of the DVL, which a compass that errs at the end does not swing about.
bool NavigationGraph::linkFitsButForYaw(const Frame& from, const Frame& to, double contradiction) const {
  const SensorNoise& noise = config_.noise;
  const SE3 &T_a_b = seen_.link.T_a_b, T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  const double way = T_a_b.translation().norm(),
               place = std::hypot(stepSigma(way, to.quality, noise), kMeanTurn * contradiction * way);
  Vector6d sigma;
  sigma << place, place, std::hypot(place, 2 * noise.depth), 2 * noise.tilt, 2 * noise.tilt, 0;
  Matrix6d spread = sigma.cwiseAbs2().asDiagonal();
  spread(5, 5) = kYawUnjudged;
  const Matrix6d at_dvl = perturbationAt(config_.dvl_in_camera);
  const SE3 T_odom_seen = from.T_odom_cam * T_a_b;
  Vector6d e = perturbationOf({0, 1, T_a_b, Matrix6d::Identity()}, from.T_odom_cam, T_odom_to);
  e.head<3>() = T_odom_seen.rotation().conjugate() *
                (T_odom_to * config_.dvl_in_camera - T_odom_seen * config_.dvl_in_camera);
  const Matrix6d covariance = spread + at_dvl * seen_.link.covariance * at_dvl.transpose();
  return e.dot(covariance.ldlt().solve(e)) <= config_.gate;
}

// Which of two that contradict each other lies, the velocity before tells: a vehicle of a hundred kilograms
// does not change it in a second. A liar that goes on and on is the other one after all.
void NavigationGraph::judgeVelocity(Frame& from, Frame& to) {
  const double elapsed = std::max(to.quality.seconds, 1e-3), heading = headingOf(from.T_odom_cam);
  const SE3 T_odom_to = dvl_.corrected(from.T_odom_cam, to.T_odom_cam);
  // Of the DVL, as linkFitsButForYaw().
  const auto velocity = [&](const SE3& T_odom_then) {
    return level(T_odom_then * config_.dvl_in_camera - from.T_odom_cam * config_.dvl_in_camera, heading) /
           elapsed;
  };
  const Eigen::Vector2d reckoned = velocity(T_odom_to);
  const bool locked = to.quality.seconds_unlocked == 0;
  if (!seen_.linked) {
    if (locked && !counters_.dvl_lies) velocity_ = reckoned;
    return;
  }
  const Eigen::Vector2d visual = velocity(from.T_odom_cam * seen_.link.T_a_b);
  const auto learn = [&] {
    if (locked && to.heading.visual)
      (void)dvl_.add(from.T_odom_cam, to.T_odom_cam, seen_.link.T_a_b, seen_.link.covariance, to.quality);
  };
  if (linkFitsButForYaw(from, to, 0)) {
    contradictions_ = slips_ = 0;
    if (++agreements_ >= config_.lying_after) counters_.dvl_lies = false;
    velocity_ = visual;
    learn();
    return;
  }
  ++counters_.steps_contradicted;
  agreements_ = 0;
  const double by_dvl = (reckoned - velocity_).norm(), by_visual = (visual - velocity_).norm();
  const bool known = from.quality.seconds > 0 && elapsed < kStaleVelocity_s;
  const bool slips = locked && !counters_.dvl_lies && known && slips_ < config_.lying_after &&
                     by_visual > kTwice * by_dvl + kLeastChange;
  if (slips) {
    to.link_slips = true;
    contradictions_ = 0;
    ++slips_;
    velocity_ = reckoned;
    return;
  }
  for (int k = keyframes() - 2; slips_ > 0 && has(k); --k, --slips_) {
    frames_[at(k)].link_slips = false;
    frames_[at(k)].dvl_lies = true;
    ++contradictions_;
    weigh(frames_[at(k)]);
  }
  slips_ = 0;
  to.dvl_lies = true;
  velocity_ = visual;
  learn();
  if (++contradictions_ >= config_.lying_after) counters_.dvl_lies = true;
}

void NavigationGraph::judge() {
  if (!seen_.waits) return;
  seen_.waits = false;
  const int newest = keyframes() - 1;
  Frame &from = frames_[at(newest - 1)], &to = frames_[at(newest)];
  const StepTurns turns = turnsOf(from, to);
  heading_.add(turns);
  to.heading.visual = heading_.verdict(newest - 1).visual;
  const double doubt = std::hypot(turns.visual_sigma, 2 * config_.noise.heading,
                                  config_.noise.deviation_turn * std::sqrt(std::abs(turns.compass)));
  if (turns.has_visual && std::abs(wrapAngle(turns.visual - turns.compass)) > config_.turned_sigmas * doubt)
    ++counters_.steps_contradicted;
  if (turns.has_gyro) {
    const double turn = wrapAngle(turns.gyro - heading_.gyroBias() * turns.seconds);
    (void)addFactor(gyroFactor(from.node, to.node, from.T_odom_cam, to.T_odom_cam, turn - turns.compass,
                               heading_.gyroSigma(turns)));
  }
  if (const double wrong = std::abs(wrapAngle(turns.visual - turns.compass));
      turns.has_visual && to.heading.visual && wrong > doubt) {
    const double way = seen_.link.T_a_b.translation().norm(),
                 sigma = stepSigma(way, to.quality, config_.noise), turned = kMeanTurn * wrong * way;
    to.step_weight = sigma * sigma / (sigma * sigma + turned * turned);
  }
  judgeVelocity(from, to);
  seen_.linked = false;
  takeVerdicts(static_cast<int>(heading_.firstChanged()) + 1);
  const bool seen = to.link >= 0 && !to.visualLies(),
             reckoned = !to.dvl_lies && !counters_.dvl_lies && to.quality.seconds_unlocked == 0;
  const bool headed = seen || turns.has_gyro || (to.heading.compass && to.attitude >= 0);
  if (!headed || !(seen || reckoned)) trouble_ns_ = to.utc_ns;
}

// Verdicts on the heading from a keyframe on. Where the compass has another reference, the drift to the first
// one that begins there or later is loosened; readings in between, of a reference that mixes both, are not
// believed.
void NavigationGraph::takeVerdicts(int keyframe) {
  bool mixed = has(keyframe - 1) && frames_[at(keyframe - 1)].mixed;
  for (int k = keyframe; k < keyframes(); ++k) {
    if (!has(k)) continue;
    Frame& frame = frames_[at(k)];
    const bool had_leapt = frame.heading.restarts;
    frame.heading = heading_.verdict(k - 1);
    if (!frame.leapt && frame.heading.restarts && !had_leapt) ++counters_.compass_jumps;
    if (!frame.leapt && !frame.heading.restarts && had_leapt) --counters_.compass_jumps;
    mixed = mixed || frame.heading.restarts;
    if (frame.heading.restarts) jumped_ns_ = std::max(jumped_ns_, frame.utc_ns);
    if (frame.drift >= 0) {
      if (const double weight = mixed ? kWidened : 1; solver_.measurement(frame.drift).weight != weight)
        (void)solver_.setWeight(frame.drift, weight);
      mixed = false;
    }
    frame.mixed = mixed;
    weigh(frame);
  }
  jump_waits_ = mixed;
}

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

Taken NavigationGraph::addLink(LinkKind kind, int a, int b, const SE3& T_a_b, const Matrix6d& covariance) {
  if (!has(a) || !has(b) || a == b || !covariance.allFinite()) {
    ++counters_.links_refused;
    return Taken::kBad;
  }
  Frame& to = frames_[at(b)];
  const RelativePose factor = linkFactor(frames_[at(a)].node, to.node, T_a_b, covariance);
  const bool chain = kind == LinkKind::kOdometry && b == a + 1 && b == keyframes() - 1 && seen_.waits;
  if ((!chain && robust_.size() == robust_.capacity()) || !factor.information.allFinite()) {
    ++counters_.links_refused;
    return Taken::kFull;
  }
  const bool agreed = kind == LinkKind::kAgreed;
  if (!chain && !agreed) {
    const Prediction known = predict(a, b);
    const bool fits = distance2(factor, config_.known_scale * known.covariance + covariance) <= config_.gate;
    if (!fits) ++counters_.links_contradicting;
    if (!fits && !agreesWithRefused(a, b, T_a_b, covariance)) return Taken::kContradicts;
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
    seen_.linked = true;
    seen_.link = {T_a_b, covariance};
  } else {
    robust_of_[at(measurement)] = static_cast<int>(robust_.size());
    robust_.push_back(
        {factor.from, factor.to, T_a_b, covariance, measurement, kLinkFree, 1, false, false, agreed});
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
                              const Eigen::Vector2d& north_east, double sigma) {
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
  const SE3& T_nav_cam = solver_.pose(frame.node);
  const RelativePose factor =
      fixFactor(kWorld, frame.node, T_nav_cam, frame.T_odom_cam, antenna_in_odom, north_east, sigma);
  const Eigen::Matrix3d R = T_nav_cam.matrix3();
  const Eigen::Matrix2d spread =
      (R * solver_.covariance(frame.node).topLeftCorner<3, 3>() * R.transpose()).topLeftCorner<2, 2>() +
      sigma * sigma * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d innovation = (factor.T_from_to.translation() - T_nav_cam.translation()).head<2>();
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
  robust_of_[at(measurement)] = static_cast<int>(robust_.size());
  robust_.push_back({factor.from, factor.to, factor.T_from_to, factor.information, measurement, kFixFree, 1,
                     true, false, insisted});
  ++counters_.fixes;
  return Taken::kYes;
}

// Robust weights of the newest factors and of some older ones in turn. A factor is switched off only by poses
// that have come to rest, and on again when it is as likely as a new one must be.
void NavigationGraph::reweight(bool settled) {
  if (robust_.empty()) return;
  const auto look = [&](Robust& r) {
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
    const Vector6d e = relativePoseError(r.factor(), SE3(), solver_.pose(r.to));
    return e.dot(r.spread * e) <= r.free_chi2;
  }
  const Matrix6d known = solver_.relativeCovariance(r.from, r.to);
  return distance2(r.factor(), config_.known_scale * known + r.spread) <= config_.gate;
}

StepReport NavigationGraph::step() {
  judge();
  const StepReport report = solver_.step();
  reweight(report.decrease_expected <= kSettled * (1 + report.chi2) && !report.waits_for_factor);
  noteChanges();
  return report;
}

}  // namespace fathom::slam
