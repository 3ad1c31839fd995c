#include "tests/onboard/synthetic_survey.hpp"

#include <algorithm>
#include <random>

#include "realtime/base/units.hpp"

namespace fathom::onboard::testing {
namespace {

constexpr std::int64_t kStart = 1'800'000'000'000'000'000;
constexpr double kSpeed = 0.5, kInterval = 0.5, kAltitude = 2.0, kDepth = 20.0;
constexpr double kLine = 6.0, kSpacing = 0.7;
constexpr int kLines = 4;
constexpr std::size_t kFeatures = 220;

struct GroundPoint {
  Eigen::Vector3d place;
  std::array<std::uint8_t, 128> descriptor;
};

struct Area {
  double north_from, north_to, east_from, east_to;
};

std::vector<GroundPoint> makeGround(const Area& area, std::mt19937& random) {
  constexpr double kPoints = 163;  // in a square metre
  std::uniform_real_distribution<double> north(area.north_from, area.north_to),
      east(area.east_from, area.east_to);
  std::normal_distribution<double> relief(kDepth + kAltitude, 0.05);
  std::exponential_distribution<double> histogram(1.0);
  const double square_metres = (area.north_to - area.north_from) * (area.east_to - area.east_from);
  std::vector<GroundPoint> ground(static_cast<std::size_t>(std::lround(kPoints * square_metres)));
  for (GroundPoint& p : ground) {
    p.place = {north(random), east(random), relief(random)};
    std::array<double, 128> h{};
    double sum = 0;
    for (double& v : h) sum += v = histogram(random);
    for (std::size_t i = 0; i < h.size(); ++i)
      p.descriptor[i] = static_cast<std::uint8_t>(std::min(255.0, 512 * std::sqrt(h[i] / sum)));
  }
  return ground;
}

// Other ground that looks alike: points in other places, with the looks of some of the first.
void addLikeness(std::vector<GroundPoint>& ground, const Area& area, std::mt19937& random) {
  const std::size_t models = ground.size();
  for (GroundPoint p : makeGround(area, random)) {
    p.descriptor = ground[random() % models].descriptor;
    ground.push_back(p);
  }
}

// What the rig sees of the ground; points come in the order of their strength, so that views agree in them.
closure::FrameFeatures look(const std::vector<GroundPoint>& ground, const StereoRig& rig,
                            const SE3& T_nav_cam, std::mt19937& random) {
  constexpr double kPixel = 0.15;  // standard deviation of a place in an image [px]
  std::normal_distribution<double> noise(0, kPixel);
  std::normal_distribution<double> wear(0, 6);  // of a descriptor's values from view to view
  const SE3 T_cam_nav = T_nav_cam.inverse();
  closure::FrameFeatures seen;
  for (const GroundPoint& p : ground) {
    if (seen.size() == kFeatures) break;
    const Eigen::Vector3d in_left = T_cam_nav * p.place;
    if ((in_left - Eigen::Vector3d(0, 0, kAltitude)).head<2>().norm() > kAltitude) continue;
    const Eigen::Vector2d left = rig.left.project(in_left),
                          right = rig.right.project(rig.T_right_left * in_left);
    if (!rig.left.contains(left, 10) || !rig.right.contains(right, 10)) continue;
    const Eigen::Vector2d l = left + Eigen::Vector2d(noise(random), noise(random));
    const Eigen::Vector2d r = right + Eigen::Vector2d(noise(random), noise(random));
    Eigen::Vector3d point;
    double gap = 0;
    if (!triangulateMidpoint(rig, rig.left.ray(l), rig.right.ray(r), point, gap)) continue;
    const double z = point.z(), f = rig.left.fx, b = rig.baseline();
    const auto sz = static_cast<float>(z * z * 1.5 * kPixel / (f * b)),
               sx = static_cast<float>(z * kPixel / f);
    closure::Feature feature{.left = l.cast<float>(),
                             .right = r.cast<float>(),
                             .point = point.cast<float>(),
                             .covariance = {},
                             .size = {}};
    const auto x = static_cast<float>(point.x() / z), y = static_cast<float>(point.y() / z);
    feature.covariance = {sx * sx + x * x * sz * sz, x * y * sz * sz, x * sz * sz,
                          sx * sx + y * y * sz * sz, y * sz * sz,     sz * sz};
    feature.size = 8;
    seen.features.push_back(feature);
    for (const std::uint8_t d : p.descriptor)
      seen.descriptors.push_back(static_cast<std::uint8_t>(std::clamp(d + wear(random), 0.0, 255.0)));
  }
  return seen;
}

// Position and heading along a boustrophedon with square turns, and a line back across.
struct Pose2 {
  Eigen::Vector2d place;
  double heading;
};
std::vector<Eigen::Vector2d> lawnMower() {
  std::vector<Eigen::Vector2d> corners;
  for (int i = 0; i < kLines; ++i) {
    const double e = i * kSpacing;
    corners.emplace_back(i % 2 == 0 ? 0 : kLine, e);
    corners.emplace_back(i % 2 == 0 ? kLine : 0, e);
  }
  corners.emplace_back(kLine / 2, (kLines - 1) * kSpacing);
  corners.emplace_back(kLine / 2, 0);
  return corners;
}

std::vector<Pose2> trackAlong(const std::vector<Eigen::Vector2d>& corners) {
  std::vector<Pose2> poses;
  const double step = kSpeed * kInterval;
  double heading = 0;
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const Eigen::Vector2d leg = corners[c + 1] - corners[c];
    const double wanted = std::atan2(leg.y(), leg.x());
    while (std::abs(wrapAngle(wanted - heading)) > 0.01) {  // turns on the spot, as a hovering vehicle does
      heading += std::clamp(wrapAngle(wanted - heading), -0.25, 0.25);
      poses.push_back({corners[c], heading});
    }
    const int steps = static_cast<int>(std::lround(leg.norm() / step));
    for (int k = 0; k < steps; ++k) poses.push_back({corners[c] + leg * ((k + 1.0) / steps), heading});
  }
  return poses;
}

SE3 cameraAt(const Eigen::Vector2d& place, double heading) {
  return SE3::fromEuler(0, 0, heading + 1.5707963267948966, {place.x(), place.y(), kDepth});
}

}  // namespace

bool MemorySlots::write(std::size_t slot, std::span<const std::uint8_t> data) {
  if (fails || slot >= blocks_.size() || data.size() > bytes_) return false;
  blocks_[slot].resize(bytes_);
  std::copy(data.begin(), data.end(), blocks_[slot].begin());
  return true;
}

bool MemorySlots::read(std::size_t slot, std::span<std::uint8_t> data) {
  if (fails || slot >= blocks_.size() || data.size() > blocks_[slot].size()) return false;
  std::copy_n(blocks_[slot].begin(), data.size(), data.begin());
  return true;
}

SyntheticSurvey syntheticSurvey(const DiveFaults& faults, std::uint32_t seed, DiveTrack track) {
  constexpr double kJump = 0.349, kStep = 0.12, kDvlError = 0.25;  // [rad], [rad], [m/s]
  constexpr double kAstray = 10, kTurnedAstray = 1.745;            // [m], [rad]
  std::mt19937 random(seed);
  std::vector<Eigen::Vector2d> corners = lawnMower();
  Area area{-2.5, kLine + 2.5, -2.5, kLines * kSpacing + 2.5};
  if (track != DiveTrack::kLawnMower) {
    corners = {{0, 0}, {8, 0}, {8, 10}, {4, 10}, {4, -3}};
    area = {-2.5, 10.5, -5.5, 12.5};
  }
  std::vector<GroundPoint> ground = makeGround(area, random);
  if (track == DiveTrack::kElsewhere) {
    constexpr double kAway = 40;  // [m]
    addLikeness(ground, {area.north_from + kAway, area.north_to + kAway, area.east_from, area.east_to},
                random);
    for (std::size_t c = 2; c < corners.size(); ++c) corners[c].x() += kAway;
  }
  SyntheticSurvey dive;
  dive.rig.left = {680, 512, 900, 900, 340, 256, 0, 0, 0, 0, 0};
  dive.rig.right = dive.rig.left;
  dive.rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), {-0.07, 0, 0});
  dive.rigs = calibration::RigHistory(dive.rig);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share;
  const Eigen::Vector2d shift(3.0, -2.0);  // nav - odom
  Eigen::Vector2d odom(0, 0);
  Eigen::Vector2d before(0, 0);
  double jumped = 0;
  nav::DeadReckoning::Quality quality;
  const std::vector<Pose2> poses = trackAlong(corners);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const double t = static_cast<double>(k) * kInterval;
    SyntheticSurvey::Frame frame;
    frame.utc_ns = kStart + static_cast<std::int64_t>(t * kNanosecondsPerSecond);
    frame.truth = cameraAt(poses[k].place, poses[k].heading);
    const double deviation = 0.03 + 0.03 * std::sin(poses[k].heading + 0.7);
    const bool jumps = t >= faults.compass_jumps_at;
    if ((jumps || t >= faults.astray_to) && quality.heading_leaps == 0) {
      quality.heading_leaps = 1;
      jumped = jumps ? kJump : kTurnedAstray;
    }
    const double stepped = t >= faults.compass_steps_at ? kStep : 0;
    const double error = deviation + jumped + stepped + 0.003 * normal(random);
    const Eigen::Rotation2Dd turned(error);
    Eigen::Vector2d moved = 1.005 * (turned * (poses[k].place - before));
    if (t >= faults.dvl_dead_from && t < faults.dvl_dead_to) {
      moved.setZero();
      quality.unlocked_s += kInterval;
    }
    if (t >= faults.dvl_stuck_from && t < faults.dvl_stuck_to) moved *= 0.5;
    if (t >= faults.dvl_wrong_from && t < faults.dvl_wrong_to)
      moved += Eigen::Rotation2Dd(poses[k].heading + error) * Eigen::Vector2d(0, kDvlError * kInterval);
    if (t >= faults.astray_from && t < faults.astray_to) {
      moved.y() += kAstray * kInterval / (faults.astray_to - faults.astray_from);
      quality.unlocked_s += kInterval;
    }
    odom += moved;
    before = poses[k].place;
    frame.features = look(ground, dive.rig, frame.truth, random);
    if (t >= faults.blind_from && t < faults.blind_to) frame.features = {};
    frame.input.utc_ns = frame.utc_ns;
    frame.input.T_odom_cam = cameraAt(odom, poses[k].heading + error);
    frame.input.quality = quality;
    frame.input.range = kAltitude;
    if (k % 10 == 5) {
      const bool wild = share(random) < faults.wild_share;
      const double sigma = wild ? 40 : 0.5;
      dive.fixes.push_back(
          {frame.utc_ns,
           frame.utc_ns + 3 * static_cast<std::int64_t>(kNanosecondsPerSecond),
           {odom.x(), odom.y(), kDepth},
           poses[k].place + shift + sigma * Eigen::Vector2d(normal(random), normal(random))});
    }
    frame.truth =
        SE3(frame.truth.rotation(), frame.truth.translation() + Eigen::Vector3d(shift.x(), shift.y(), 0));
    dive.frames.push_back(std::move(frame));
  }
  return dive;
}

std::vector<SE3> localised(LocalisationCore& core, const SyntheticSurvey& dive) {
  core.setAnchor(nav::FixKind::kGps, {3.3, -2.2}, 0.5);
  struct Hanging {
    int keyframe;
    SE3 T_odom_cam;
  };
  std::vector<Hanging> hanging;
  core.setRetiredObserver([&](const slam::NavigationGraph::Retired& gone) {
    for (Hanging& h : hanging)
      if (h.keyframe == gone.keyframe) h = {gone.onto, gone.T_onto * h.T_odom_cam};
  });
  std::size_t next_fix = 0;
  for (const SyntheticSurvey::Frame& frame : dive.frames) {
    for (; next_fix < dive.fixes.size() && dive.fixes[next_fix].arrival_ns <= frame.utc_ns; ++next_fix)
      dive.fixes[next_fix].addTo(core);
    hanging.push_back({frame.placeIn(core), frame.input.T_odom_cam});
  }
  core.finish();
  core.setRetiredObserver({});
  std::vector<SE3> poses;
  for (const Hanging& h : hanging) poses.push_back(core.poseOf(h.keyframe, h.T_odom_cam));
  return poses;
}

PlanError planError(const SyntheticSurvey& dive, const std::vector<SE3>& poses) {
  Eigen::Vector2d mean_a(0, 0), mean_b(0, 0);
  const auto n = static_cast<double>(poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    mean_a += poses[k].translation().head<2>() / n;
    mean_b += dive.frames[k].truth.translation().head<2>() / n;
  }
  double c = 0, s = 0;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const Eigen::Vector2d a = poses[k].translation().head<2>() - mean_a;
    const Eigen::Vector2d b = dive.frames[k].truth.translation().head<2>() - mean_b;
    c += a.dot(b);
    s += a.x() * b.y() - a.y() * b.x();
  }
  const Eigen::Rotation2Dd turn(std::atan2(s, c));
  PlanError error;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const Eigen::Vector2d a = poses[k].translation().head<2>(),
                          b = dive.frames[k].truth.translation().head<2>();
    error.rms += (turn * (a - mean_a) - (b - mean_b)).squaredNorm() / n;
    error.absolute += (a - b).squaredNorm() / n;
  }
  return {std::sqrt(error.rms), std::sqrt(error.absolute)};
}

MemorySlots featureSlots(std::size_t slots, const LocalisationConfig& config) {
  return {slots, closure::slotBytes(static_cast<std::size_t>(config.features))};
}

LocalisationConfig smallLocalisation() {
  LocalisationConfig config{.max_keyframes = 300, .features = static_cast<int>(kFeatures), .graph = {}};
  config.graph.max_links = 1000;
  config.graph.max_fixes = 100;
  return config;
}

}  // namespace fathom::onboard::testing
