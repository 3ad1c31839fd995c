#include "recon/topside/input/navigation.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <queue>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/navigation/dead_reckoning/position_anchor.hpp"

namespace fathom::topside {
namespace {

// Fixes that state no error of their own [m].
constexpr double kDefaultFixSigma = 5.0;
// GPS errors last for minutes: of a vehicle at the surface, one fix in so long tells all, as on board.
constexpr std::int64_t kGpsInterval = 60 * kSecond_ns;

std::int64_t shifted(std::int64_t utc_ns, double offset_s) {
  return utc_ns + rt::nanoseconds(offset_s);
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

// Samples of the sensors that navigate in the order of their stamps, which are UTC: a recorder logs them as
// they arrive, late and in batches where a driver has it so.
class SortedLog {
 public:
  template <typename Sample>
  static constexpr bool kNavigates =
      std::is_same_v<Sample, DvlSample> || std::is_same_v<Sample, AttitudeSample> ||
      std::is_same_v<Sample, GyroSample> || std::is_same_v<Sample, DepthSample> ||
      std::is_same_v<Sample, WaterSample>;

  SortedLog(const io::MissionPaths& paths, const io::MissionConfig::TimeOffsets& offsets,
            double attitude_late)
      : offsets_(offsets), attitude_late_(attitude_late), file_(paths.root) {}

  std::optional<SensorSample> next() {
    while (waiting_.size() < kWaiting) {
      auto entry = file_.next();
      if (!entry) break;
      const std::optional<std::int64_t> utc_ns = stamp(entry->sample);
      if (utc_ns) waiting_.push({*utc_ns, read_++, std::move(entry->sample)});
    }
    if (waiting_.empty()) return std::nullopt;
    SensorSample sample = waiting_.top().sample;
    waiting_.pop();
    return sample;
  }
  [[nodiscard]] const io::SensorLogReader& file() const { return file_; }

 private:
  static constexpr std::size_t kWaiting = 1024;  // half a minute of all sensors
  struct Waiting {
    std::int64_t utc_ns;
    std::uint64_t read;
    SensorSample sample;
    // Of the same moment the velocity is last: it is tracked by the others.
    [[nodiscard]] bool velocity() const { return std::holds_alternative<DvlSample>(sample); }
    bool operator<(const Waiting& other) const {
      return std::tuple(other.utc_ns, other.velocity(), other.read) < std::tuple(utc_ns, velocity(), read);
    }
  };

  // Puts a sample's stamp right; nothing where it is of another sensor.
  [[nodiscard]] std::optional<std::int64_t> stamp(SensorSample& sample) const {
    return std::visit(
        [&](auto& s) -> std::optional<std::int64_t> {
          using Sample = std::decay_t<decltype(s)>;
          if constexpr (!kNavigates<Sample>) return std::nullopt;
          double offset = 0;
          if constexpr (std::is_same_v<Sample, DvlSample>) offset = offsets_.dvl;
          if constexpr (std::is_same_v<Sample, AttitudeSample> || std::is_same_v<Sample, GyroSample>)
            offset = offsets_.compass;
          if constexpr (std::is_same_v<Sample, AttitudeSample>) offset -= attitude_late_;
          if constexpr (std::is_same_v<Sample, DepthSample>) offset = offsets_.depth;
          s.utc_ns = shifted(s.utc_ns, offset);
          return s.utc_ns;
        },
        sample);
  }

  const io::MissionConfig::TimeOffsets& offsets_;
  double attitude_late_;
  io::SensorLogReader file_;
  std::priority_queue<Waiting> waiting_;
  std::uint64_t read_ = 0;
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

// GPS fixes of a vehicle that comes up during the dive, taken out of those before it.
std::vector<Fix> takeSurfaced(std::vector<Fix>& gps, std::int64_t first_image) {
  const auto dive =
      std::find_if(gps.begin(), gps.end(), [&](const Fix& f) { return f.utc_ns >= first_image; });
  std::vector<Fix> surfaced;
  for (auto fix = dive; fix != gps.end(); ++fix)
    if (surfaced.empty() || fix->utc_ns - surfaced.back().utc_ns >= kGpsInterval) surfaced.push_back(*fix);
  gps.erase(dive, gps.end());
  return surfaced;
}

std::vector<NavigatedPose> wantedAt(const std::vector<Fix>& fixes) {
  std::vector<NavigatedPose> out;
  for (const Fix& fix : fixes) out.push_back({fix.utc_ns, {}, {}, {}});
  return out;
}

// Where dead reckoning began, and the images that it was read out for.
struct Reckoned {
  SE3 first;
  std::int64_t first_utc_ns = 0;
  const std::vector<NavigatedPose>& images;
  double unknown_velocity;  // standard deviation without bottom track [m/s]

  // Seconds of unknown motion between a fix and the image nearest to it.
  [[nodiscard]] double unlockedAt(const NavigatedPose& fix) const {
    if (images.empty()) return 0;
    const std::int64_t t = fix.utc_ns;
    auto near =
        std::lower_bound(images.begin(), images.end(), t,
                         [](const NavigatedPose& image, std::int64_t at) { return image.utc_ns < at; });
    if (near == images.end() || (near != images.begin() && t - (near - 1)->utc_ns < near->utc_ns - t)) --near;
    const double before = static_cast<double>(std::max<std::int64_t>(first_utc_ns - t, 0)) * 1e-9;
    return before + std::abs(near->quality.unlocked_s - fix.quality.unlocked_s);
  }
};

// Fixes with where dead reckoning has the receiver, and what each says of odom's origin into `anchor`, if
// there is one. Before bottom track the vehicle is taken to be where dead reckoning began, and its fixes to
// be as wrong as it may have moved. `lever`: of the receiver in body.
std::vector<FixSeen> seenBy(nav::FixKind kind, const std::vector<Fix>& fixes,
                            const std::vector<NavigatedPose>& poses, const Reckoned& reckoned,
                            const Eigen::Vector3d& lever, nav::PositionAnchor* anchor) {
  std::vector<FixSeen> seen;
  for (std::size_t k = 0; k < fixes.size(); ++k) {
    std::optional<SE3> pose = poses[k].T_nav_body;
    if (!pose && fixes[k].utc_ns < reckoned.first_utc_ns) pose = reckoned.first;
    if (!pose) continue;
    const Eigen::Vector2d place(fixes[k].north, fixes[k].east);
    const Eigen::Vector3d receiver = *pose * lever;
    const double unlocked = reckoned.unlockedAt(poses[k]);
    if (anchor) anchor->add(kind, place - receiver.head<2>(), fixes[k].sigma, unlocked);
    const double sigma = hypotenuse(fixes[k].sigma, reckoned.unknown_velocity * unlocked);
    seen.push_back({kind, fixes[k].utc_ns, place, sigma, receiver});
  }
  return seen;
}

Anchor anchorOf(const nav::PositionAnchor& fixes, double unknown_velocity) {
  Anchor anchor;
  const auto estimate = fixes.estimate(0, unknown_velocity);
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
                    const TopsideConfig& config, const std::vector<std::int64_t>& times,
                    double attitude_late) {
  Navigation out;
  Fixes fixes = readFixes(paths, mission);
  std::vector<Fix> surfaced;
  if (!times.empty()) surfaced = takeSurfaced(fixes.gps, times.front());
  for (const std::int64_t t : times) out.poses.push_back({t, {}, {}, {}});
  for (std::int64_t t = fixes.first_utc_ns; t <= fixes.last_utc_ns && fixes.first_utc_ns > 0; t += kSecond_ns)
    out.track.push_back({t, {}, {}, {}});
  std::vector<NavigatedPose> at_gps = wantedAt(fixes.gps), at_usbl = wantedAt(fixes.usbl),
                             at_surface = wantedAt(surfaced);

  nav::DeadReckoningConfig reckoning;
  reckoning.T_body_dvl = mission.T_body_dvl;
  reckoning.T_body_depth = mission.T_body_depth;
  reckoning.T_body_compass = mission.T_body_compass;
  reckoning.magnetic_declination = mission.magnetic_declination;
  reckoning.origin_latitude = mission.origin.latitude;
  reckoning.sound_speed = mission.water.sound_speed;
  reckoning.phased_array = mission.dvl.phased_array;
  reckoning.tide = readTide(mission.tide_model, mission.start_utc_ns);
  reckoning.max_dvl_gap = config.max_dvl_gap;
  reckoning.max_speed = config.max_speed;
  nav::DeadReckoning track(reckoning);

  Reader readers[] = {Reader(out.poses), Reader(out.track), Reader(at_gps), Reader(at_usbl),
                      Reader(at_surface)};
  std::optional<SE3> first;
  std::int64_t first_utc_ns = 0;
  SortedLog log(paths, mission.time_offsets, attitude_late);
  while (auto sample = log.next()) {
    std::visit(
        [&](auto& s) {
          using Sample = std::decay_t<decltype(s)>;
          if constexpr (SortedLog::kNavigates<Sample>) track.add(s);
        },
        *sample);
    if (!first && track.initialised()) {
      first_utc_ns = track.oldestUtcNs();
      first = track.poseAt(first_utc_ns);
    }
    for (Reader& reader : readers) reader.readOut(track, false);
  }
  for (Reader& reader : readers) reader.readOut(track, true);
  out.counters = track.counters();
  out.skipped_entries = log.file().skippedEntries();
  out.damaged_entries = log.file().damagedEntries();
  if (!first)
    throw InputError(
        paths.root.string(), "sensor log",
        "no navigation: attitude, depth and bottom-track velocity are all needed; check the recording");

  const double unknown_velocity = config.navigation.noise.unknown_velocity;
  const Reckoned reckoned{*first, first_utc_ns, out.poses, unknown_velocity};
  nav::PositionAnchor anchor(config.navigation.noise.usbl_shift);
  const std::vector<FixSeen> before =
      seenBy(nav::FixKind::kGps, fixes.gps, at_gps, reckoned, {0, 0, 0}, &anchor);
  const auto by_gps = anchor.estimate(0, unknown_velocity);
  const std::vector<FixSeen> usbl =
      seenBy(nav::FixKind::kUsbl, fixes.usbl, at_usbl, reckoned, mission.T_body_usbl.translation(), &anchor);
  const std::vector<FixSeen> later =
      seenBy(nav::FixKind::kGps, surfaced, at_surface, reckoned, {0, 0, 0}, by_gps ? nullptr : &anchor);
  for (const auto* list : {&before, &usbl, &later})
    out.fixes.insert(out.fixes.end(), list->begin(), list->end());
  out.anchor = anchorOf(anchor, unknown_velocity);
  const SE3 T_nav_odom(Eigen::Quaterniond::Identity(), {out.anchor.north, out.anchor.east, 0});
  if (by_gps) {
    out.gps_shift = by_gps->shift - Eigen::Vector2d(out.anchor.north, out.anchor.east);
    out.gps_sigma = by_gps->sigma;
  }
  for (FixSeen& fix : out.fixes) fix.receiver = T_nav_odom * fix.receiver;
  for (auto* poses : {&out.poses, &out.track})
    for (NavigatedPose& pose : *poses)
      if (pose.T_nav_body) pose.T_nav_body = T_nav_odom * *pose.T_nav_body;
  return out;
}

}  // namespace fathom::topside
