#include "recon/topside/stages/navigation.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

#include "firmware_if/sensor_log.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/nav/position_anchor.hpp"

namespace fathom::topside {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
// Fixes that state no error of their own [m].
constexpr double kDefaultFixSigma = 5.0;
constexpr double kDescentDrift = 0.05;  // of a vehicle without bottom track [m/s]

std::int64_t shifted(std::int64_t utc_ns, double offset_s) {
  return utc_ns + std::llround(offset_s * 1e9);
}

// Reads the track out at ascending times while it is being reckoned: the history behind it is short.
class Reader {
 public:
  explicit Reader(std::vector<NavigatedPose>& wanted) : wanted_(wanted) {}

  void readOut(const nav::DeadReckoning& track, bool end) {
    if (!track.initialised()) return;
    while (next_ < wanted_.size() && (end || wanted_[next_].utc_ns <= track.newestUtcNs())) {
      wanted_[next_].T_nav_body = track.poseAt(wanted_[next_].utc_ns);  // still in odom
      wanted_[next_].altitude = track.altitude();
      wanted_[next_].quality = track.qualityAt(wanted_[next_].utc_ns);
      ++next_;
    }
  }

 private:
  std::vector<NavigatedPose>& wanted_;
  std::size_t next_ = 0;
};

struct Fix {
  std::int64_t utc_ns = 0;
  double north = 0, east = 0, sigma = 0;
};

template <typename Sample>
Fix toFix(const Sample& sample, const LocalTransverseMercator& projection) {
  const Eigen::Vector2d p = projection.toLocal({sample.latitude, sample.longitude});
  return {sample.utc_ns, p.x(), p.y(),
          sample.sigma_horizontal > 0 ? sample.sigma_horizontal : kDefaultFixSigma};
}

struct Fixes {
  std::vector<Fix> gps, usbl;
  std::int64_t first_utc_ns = 0, last_utc_ns = 0;  // of the sensors that navigate
};

Fixes readFixes(const io::MissionPaths& paths, const io::MissionConfig& mission) {
  const LocalTransverseMercator projection(mission.origin);
  Fixes fixes;
  io::SensorLogReader reader(paths.root);
  while (const auto entry = reader.next()) {
    if (const auto* gps = std::get_if<GpsFix>(&entry->sample)) fixes.gps.push_back(toFix(*gps, projection));
    if (const auto* usbl = std::get_if<UsblFix>(&entry->sample))
      fixes.usbl.push_back(toFix(*usbl, projection));
    if (const auto* dvl = std::get_if<DvlSample>(&entry->sample)) {
      if (fixes.first_utc_ns == 0) fixes.first_utc_ns = dvl->utc_ns;
      fixes.last_utc_ns = std::max(fixes.last_utc_ns, dvl->utc_ns);
    }
  }
  const auto by_time = [](const Fix& a, const Fix& b) { return a.utc_ns < b.utc_ns; };
  std::stable_sort(fixes.gps.begin(), fixes.gps.end(), by_time);
  std::stable_sort(fixes.usbl.begin(), fixes.usbl.end(), by_time);
  return fixes;
}

std::vector<NavigatedPose> wantedAt(const std::vector<Fix>& fixes) {
  std::vector<NavigatedPose> out;
  for (const Fix& fix : fixes) out.push_back({fix.utc_ns, {}, {}, {}});
  return out;
}

// What each fix says of odom's origin. Before bottom track the vehicle is taken to be where dead reckoning
// began. `lever`: of the receiver in body.
void addFixes(nav::PositionAnchor& anchor, nav::FixKind kind, const std::vector<Fix>& fixes,
              const std::vector<NavigatedPose>& poses, const SE3& first, std::int64_t first_utc_ns,
              const Eigen::Vector3d& lever, std::vector<FixSeen>& seen) {
  for (std::size_t k = 0; k < fixes.size(); ++k) {
    std::optional<SE3> pose = poses[k].T_nav_body;
    if (!pose && fixes[k].utc_ns < first_utc_ns) pose = first;
    if (!pose) continue;
    const Eigen::Vector3d receiver = *pose * lever;
    anchor.add(kind, {fixes[k].north - receiver.x(), fixes[k].east - receiver.y()}, fixes[k].sigma);
    seen.push_back({kind, fixes[k].utc_ns, {fixes[k].north, fixes[k].east}, fixes[k].sigma, receiver});
  }
}

Anchor anchorOf(const nav::PositionAnchor& fixes) {
  Anchor anchor;
  const auto estimate = fixes.estimate();
  if (!estimate) return anchor;
  anchor.source = estimate->usbl_used == 0 ? "gps" : estimate->gps_used == 0 ? "usbl" : "gps and usbl";
  anchor.north = estimate->shift.x();
  anchor.east = estimate->shift.y();
  anchor.sigma = estimate->sigma;
  anchor.fixes_used = estimate->gps_used + estimate->usbl_used;
  anchor.fixes_rejected = estimate->outliers + static_cast<int>(fixes.counters().refused);
  return anchor;
}

}  // namespace

Navigation navigate(const io::MissionPaths& paths, const io::MissionConfig& mission,
                    const TopsideConfig& config, const std::vector<std::int64_t>& times) {
  Navigation out;
  Fixes fixes = readFixes(paths, mission);
  if (!times.empty()) {
    const auto before_dive = [&](const Fix& fix) { return fix.utc_ns >= times.front(); };
    fixes.gps.erase(std::remove_if(fixes.gps.begin(), fixes.gps.end(), before_dive), fixes.gps.end());
  }
  for (const std::int64_t t : times) out.poses.push_back({t, {}, {}, {}});
  for (std::int64_t t = fixes.first_utc_ns; t <= fixes.last_utc_ns && fixes.first_utc_ns > 0; t += kSecond)
    out.track.push_back({t, {}, {}, {}});
  std::vector<NavigatedPose> at_gps = wantedAt(fixes.gps), at_usbl = wantedAt(fixes.usbl);

  nav::DeadReckoningConfig reckoning;
  reckoning.T_body_dvl = mission.T_body_dvl;
  reckoning.T_body_depth = mission.T_body_depth;
  reckoning.T_body_compass = mission.T_body_compass;
  reckoning.magnetic_declination = mission.magnetic_declination;
  reckoning.sound_speed = mission.water.sound_speed;
  reckoning.max_dvl_gap = config.max_dvl_gap;
  reckoning.max_speed = config.max_speed;
  nav::DeadReckoning track(reckoning);

  Reader readers[] = {Reader(out.poses), Reader(out.track), Reader(at_gps), Reader(at_usbl)};
  std::optional<SE3> first;
  std::int64_t first_utc_ns = 0;
  io::SensorLogReader log(paths.root);
  while (auto entry = log.next()) {
    if (auto* dvl = std::get_if<DvlSample>(&entry->sample)) {
      dvl->utc_ns = shifted(dvl->utc_ns, mission.time_offsets.dvl);
      track.add(*dvl);
    } else if (auto* attitude = std::get_if<AttitudeSample>(&entry->sample)) {
      attitude->utc_ns = shifted(attitude->utc_ns, mission.time_offsets.compass);
      track.add(*attitude);
    } else if (auto* gyro = std::get_if<GyroSample>(&entry->sample)) {
      gyro->utc_ns = shifted(gyro->utc_ns, mission.time_offsets.compass);
      track.add(*gyro);
    } else if (auto* depth = std::get_if<DepthSample>(&entry->sample)) {
      depth->utc_ns = shifted(depth->utc_ns, mission.time_offsets.depth);
      track.add(*depth);
    } else if (const auto* water = std::get_if<WaterSample>(&entry->sample)) {
      track.add(*water);
    }
    if (!first && track.initialised()) {
      first_utc_ns = track.oldestUtcNs();
      first = track.poseAt(first_utc_ns);
    }
    for (Reader& reader : readers) reader.readOut(track, false);
  }
  for (Reader& reader : readers) reader.readOut(track, true);
  out.counters = track.counters();
  out.skipped_entries = log.skippedEntries();
  out.damaged_entries = log.damagedEntries();
  if (!first)
    throw InputError(
        paths.root.string(), "sensor log",
        "no navigation: attitude, depth and bottom-track velocity are all needed; check the recording");

  nav::PositionAnchor anchor;
  addFixes(anchor, nav::FixKind::kGps, fixes.gps, at_gps, *first, first_utc_ns, Eigen::Vector3d::Zero(),
           out.fixes);
  const auto by_gps = anchor.estimate();
  addFixes(anchor, nav::FixKind::kUsbl, fixes.usbl, at_usbl, *first, first_utc_ns,
           mission.T_body_usbl.translation(), out.fixes);
  out.anchor = anchorOf(anchor);
  const SE3 T_nav_odom(Eigen::Quaterniond::Identity(), {out.anchor.north, out.anchor.east, 0});
  if (by_gps) {
    const double gap =
        static_cast<double>(std::max<std::int64_t>(first_utc_ns - fixes.gps.back().utc_ns, 0)) * 1e-9;
    out.gps_shift = by_gps->shift - Eigen::Vector2d(out.anchor.north, out.anchor.east);
    out.gps_sigma = std::hypot(by_gps->sigma, kDescentDrift * gap);
  }
  for (FixSeen& fix : out.fixes) fix.receiver = T_nav_odom * fix.receiver;
  for (auto* poses : {&out.poses, &out.track})
    for (NavigatedPose& pose : *poses)
      if (pose.T_nav_body) pose.T_nav_body = T_nav_odom * *pose.T_nav_body;
  return out;
}

}  // namespace fathom::topside
