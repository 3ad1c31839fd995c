#include "recon/topside/localise/known_places.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/solver/batch/batch_solver.hpp"

namespace fathom::topside {
namespace {

// Standard deviations of what files of navigation do not say: errors of compasses last, and so count for
// more than those of single readings.
constexpr double kDepthSigma = 0.1;                                 // [m]
constexpr double kTiltSigma = 0.02, kHeadingSigma = 0.09;           // [rad]
constexpr double kVelocityStepSigma = 0.02, kVelocityError = 0.03;  // of a step by velocities [m], [1]
constexpr double kAnyPlace = 1e3, kAnyTurn = 10;                    // that hold what nothing tells [m], [rad]
constexpr double kSteep = 0.35;   // of ground that is a wrong attitude [rad]
constexpr double kNorthSpan = 3;  // of positions that tell north, in their standard deviations
constexpr double kGate = 13.82;   // of a position, 99.9 % of chi-square with 2 degrees of freedom

double weight(double sigma) {
  return 1 / (sigma * sigma);
}

SE3 turned(const Eigen::Matrix3d& R) {
  return {R, Eigen::Vector3d::Zero()};
}

// The turn about z that brings points nearest to others, both from above (Umeyama 1991 without scale); those
// three times as far off as most are left out, twice.
double turnBetween(std::vector<Eigen::Vector2d> from, std::vector<Eigen::Vector2d> to) {
  double turn = 0;
  for (int round = 0; round < 3; ++round) {
    Eigen::Vector2d a = Eigen::Vector2d::Zero(), b = Eigen::Vector2d::Zero();
    for (std::size_t k = 0; k < from.size(); ++k) a += from[k], b += to[k];
    a /= static_cast<double>(from.size());
    b /= static_cast<double>(to.size());
    double sine = 0, cosine = 0;
    for (std::size_t k = 0; k < from.size(); ++k) {
      const Eigen::Vector2d p = from[k] - a, q = to[k] - b;
      sine += p.x() * q.y() - p.y() * q.x();
      cosine += p.dot(q);
    }
    turn = std::atan2(sine, cosine);
    std::vector<double> off;
    for (std::size_t k = 0; k < from.size(); ++k)
      off.push_back((b + Eigen::Rotation2Dd(turn) * (from[k] - a) - to[k]).norm());
    const double most = 3 * median(off);
    std::size_t kept = 0;
    for (std::size_t k = 0; k < off.size(); ++k)
      if (off[k] <= most) from[kept] = from[k], to[kept++] = to[k];
    from.resize(kept);
    to.resize(kept);
  }
  return turn;
}

// Root mean square distance from the middle.
double spanOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0;
  for (const Eigen::Vector2d& p : points) sum += p, squares += p.squaredNorm();
  const auto n = static_cast<double>(points.size());
  return std::sqrt(std::max(0.0, squares / n - (sum / n).squaredNorm()));
}

}  // namespace

KnownPlaces::KnownPlaces(std::vector<KnownPose> known, std::vector<Eigen::Vector3d> ground,
                         const SE3& T_body_cam, bool mounted)
    : known_(std::move(known)),
      ground_(std::move(ground)),
      T_body_cam_(T_body_cam),
      T_cam_body_(T_body_cam.inverse()) {
  std::vector<double> steep;
  for (std::uint32_t k = 0; k < known_.size(); ++k) {
    const KnownPose& p = known_[k];
    any_ = any_ || p.north_east || p.depth || p.heading || p.tilt;
    if (p.tilt) steep.push_back(std::acos(std::clamp(downInCamera(k).dot(ground_[k]), -1.0, 1.0)));
  }
  const double usual = median(steep);
  if (mounted || usual < kSteep) return;
  refused_tilt_ = usual;
  for (KnownPose& p : known_) p.tilt.reset();
}

Eigen::Vector3d KnownPlaces::downInCamera(std::uint32_t frame) const {
  const std::optional<Eigen::Vector2d>& tilt = known_[frame].tilt;
  if (!tilt) return ground_[frame];
  const SE3 body = SE3::fromEuler(tilt->x(), tilt->y(), 0, Eigen::Vector3d::Zero());
  return T_cam_body_.rotation() * (body.rotation().conjugate() * Eigen::Vector3d::UnitZ());
}

KnownPlaces::Motion KnownPlaces::motionOf(std::span<const std::uint32_t> part,
                                          std::span<const SE3> poses) const {
  const bool attitudes =
      std::any_of(part.begin(), part.end(), [&](std::uint32_t k) { return known_[k].tilt.has_value(); });
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  for (const std::uint32_t k : part)
    if (!attitudes || known_[k].tilt) down += poses[k].rotation() * downInCamera(k);
  down.normalize();
  const SE3& first = poses[part.front()];
  Eigen::Vector3d north = first.rotation() * -Eigen::Vector3d::UnitY();  // the top of the image
  if (std::abs(north.dot(down)) > 0.99) north = first.rotation() * Eigen::Vector3d::UnitZ();
  north = (north - north.dot(down) * down).normalized();
  Eigen::Matrix3d level;
  level.row(0) = north;
  level.row(1) = down.cross(north);
  level.row(2) = down;

  double sine = 0, cosine = 0;
  std::vector<Eigen::Vector2d> here, there;
  std::vector<double> sigmas, depths;
  for (const std::uint32_t k : part) {
    const SE3 pose = turned(level) * poses[k] * T_cam_body_;
    if (known_[k].heading) {
      const double turn = *known_[k].heading - pose.euler().z();
      sine += std::sin(turn);
      cosine += std::cos(turn);
    }
    if (known_[k].north_east) {
      here.emplace_back(pose.translation().head<2>());
      there.push_back(*known_[k].north_east);
      sigmas.push_back(known_[k].sigma);
    }
    if (known_[k].depth) depths.push_back(*known_[k].depth - pose.translation().z());
  }
  double turn = 0;
  if (sine != 0 || cosine != 0)
    turn = std::atan2(sine, cosine);
  else if (here.size() > 2 && spanOf(here) > kNorthSpan * median(sigmas))
    turn = turnBetween(here, there);
  const Eigen::Matrix3d R = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix() * level;
  Eigen::Vector3d shift = -(R * first.translation());
  if (!depths.empty()) shift.z() = median(depths);
  std::array<std::vector<double>, 2> by;
  for (std::size_t k = 0; k < here.size(); ++k)
    for (int axis : {0, 1})
      by[static_cast<std::size_t>(axis)].push_back(there[k][axis] -
                                                   (Eigen::Rotation2Dd(turn) * here[k])[axis]);
  if (!here.empty()) shift.head<2>() = Eigen::Vector2d(median(by[0]), median(by[1]));
  return {SE3(R, shift), !here.empty()};
}

// An edge from nav to the frame's camera. What is not known of it is taken from `T_nav_cam`, and weighs
// nothing.
slam::RelativePose KnownPlaces::measured(std::uint32_t frame, const SE3& T_nav_cam, bool position) const {
  const KnownPose& known = known_[frame];
  const SE3 now = T_nav_cam * T_cam_body_;
  Eigen::Vector3d angles = now.euler(), place = now.translation();
  Eigen::Vector3d of_place = Eigen::Vector3d::Zero(), of_turn = Eigen::Vector3d::Zero();
  if (known.north_east && position) {
    place.head<2>() = *known.north_east;
    of_place.head<2>().setConstant(weight(known.sigma));
  }
  if (known.depth) {
    place.z() = *known.depth;
    of_place.z() = weight(kDepthSigma);
  }
  if (known.tilt) {
    angles.head<2>() = *known.tilt;
    of_turn.head<2>().setConstant(weight(kTiltSigma));
  }
  if (known.heading) {
    angles.z() = *known.heading;
    of_turn.z() = weight(kHeadingSigma);
  }
  slam::RelativePose edge;
  edge.from = 0;
  edge.to = static_cast<int>(frame) + 1;
  edge.T_from_to = SE3::fromEuler(angles.x(), angles.y(), angles.z(), place) * T_body_cam_;
  const Eigen::Matrix3d R = edge.T_from_to.matrix3();
  Matrix6d information = Matrix6d::Zero();
  information.topLeftCorner<3, 3>() = R.transpose() * of_place.asDiagonal() * R;
  information.bottomRightCorner<3, 3>() = R.transpose() * of_turn.asDiagonal() * R;
  edge.information = slam::residualInformation(0.5 * (information + information.transpose()));
  return edge;
}

KnownPlaces::Placed KnownPlaces::improved(const slam::PoseGraph& graph,
                                          std::span<const std::uint32_t> firsts) {
  constexpr int kFitRounds = 4;
  std::vector<bool> used(known_.size());
  for (std::size_t k = 0; k < known_.size(); ++k) used[k] = known_[k].north_east.has_value();
  const auto given = static_cast<std::size_t>(std::count(used.begin(), used.end(), true));
  Placed out;
  std::vector<SE3> poses = graph.poses;
  for (int round = 0; round < kFitRounds; ++round) {
    slam::PoseGraph& whole = out.graph;
    whole = {};
    whole.poses.emplace_back();
    whole.poses.insert(whole.poses.end(), poses.begin(), poses.end());
    for (std::size_t k = 0; k < whole.poses.size(); ++k) whole.ids.push_back(static_cast<std::int64_t>(k));
    for (slam::RelativePose edge : graph.edges) {
      ++edge.from;
      ++edge.to;
      whole.edges.push_back(edge);
    }
    for (std::uint32_t k = 0; k < known_.size(); ++k) {
      slam::RelativePose edge = measured(k, poses[k], used[k]);
      if (!edge.information.isZero(0)) whole.edges.push_back(edge);
    }
    Vector6d hold;
    hold << Eigen::Vector3d::Constant(weight(kAnyPlace)), Eigen::Vector3d::Constant(weight(kAnyTurn));
    for (const std::uint32_t first : firsts)
      whole.edges.push_back({0, static_cast<int>(first) + 1, poses[first],
                             slam::residualInformation(Matrix6d(hold.asDiagonal()))});
    slam::BatchOptions options;
    options.chordal = false;
    out.converged = slam::optimize(whole, options).converged;
    poses.assign(whole.poses.begin() + 1, whole.poses.end());

    std::vector<double> off(known_.size(), 0), sizes;  // in standard deviations
    for (std::size_t k = 0; k < known_.size(); ++k) {
      if (!used[k]) continue;
      const SE3 body = poses[k] * T_cam_body_;
      off[k] = (body.translation().head<2>() - *known_[k].north_east).norm() / known_[k].sigma;
      sizes.push_back(off[k]);
    }
    constexpr double kMedianOfTwo = 1.1774;  // of the length of two normal variables
    const double scale = std::max(1.0, median(sizes) / kMedianOfTwo);
    bool again = false;
    for (std::size_t k = 0; k < known_.size(); ++k)
      if (used[k] && off[k] * off[k] > kGate * scale * scale) {
        used[k] = false;
        again = true;
      }
    if (!again) break;
  }
  kept_ = static_cast<std::size_t>(std::count(used.begin(), used.end(), true));
  left_out_ = given - kept_;
  return out;
}

std::optional<slam::NavigationLink> KnownPlaces::stepTo(std::uint32_t frame) const {
  if (frame == 0 || !known_[frame].moved || !known_[frame].heading || !known_[frame - 1].heading) return {};
  const auto attitude = [&](std::uint32_t k) {
    const Eigen::Vector2d tilt = known_[k].tilt.value_or(Eigen::Vector2d::Zero());
    return SE3::fromEuler(tilt.x(), tilt.y(), *known_[k].heading, Eigen::Vector3d::Zero()) * T_body_cam_;
  };
  const SE3 a = attitude(frame - 1);
  const SE3 b = SE3(Eigen::Quaterniond::Identity(), *known_[frame].moved) * attitude(frame);
  slam::NavigationLink link;
  link.a = frame - 1;
  link.b = frame;
  link.T_a_b = a.inverse() * b;
  const double sigma = kVelocityStepSigma + kVelocityError * known_[frame].moved->norm();
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(sigma * sigma),
      Eigen::Vector3d::Constant(kHeadingSigma * kHeadingSigma);
  link.covariance = variance.asDiagonal();
  return link;
}

std::optional<KnownPlaces::Apart> KnownPlaces::apart(std::uint32_t a, std::uint32_t b) const {
  if (!known_[a].north_east || !known_[b].north_east) return {};
  return Apart{(*known_[a].north_east - *known_[b].north_east).norm(),
               hypotenuse(known_[a].sigma, known_[b].sigma)};
}

}  // namespace fathom::topside
