#include "realtime/onboard/onboard_system.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <type_traits>

#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/units.hpp"

namespace fathom::onboard {
namespace {

constexpr double kLostAfter = 3.0;        // a sensor silent for longer is reported as lost [s]
constexpr double kBatteryOldAfter = 120;  // a charge reported longer ago counts as unknown [s]
constexpr double kNoPairsAfter =
    10.0;  // without a stereo pair for longer the cameras are reported as lost [s]
// Of a fix that does not say: wide for a ship's USBL in shallow water [m].
constexpr double kUnstatedFixSigma = 5.0;
// The clocks of ship and vehicle may differ by so much at the start of the dive.
constexpr std::int64_t kClockSlack_ns = 600'000'000'000;
constexpr double kPoorPoints = 0.1;  // fewer than this share of the wanted points a pair is poor stereo

std::vector<Eigen::Vector2d> planOf(const io::MissionConfig& mission) {
  std::vector<Eigen::Vector2d> plan;
  for (const io::MissionConfig::Waypoint& w : mission.plan) plan.emplace_back(w.north, w.east);
  return plan;
}

}  // namespace

OnboardSystem::OnboardSystem(const OnboardConfig& config, const io::MissionConfig& mission,
                             const StereoRig& rig, PairSource source, const MapSlots& slots)
    : config_(config),
      mission_(mission),
      local_(mission.origin),
      source_(std::move(source)),
      nav_(navCoreConfig(config, mission)),
      map_(mapCoreConfig(config, mission, rig), slots),
      link_(linkCoreConfig(config, mission)),
      downlink_({mission.vehicle_id, mission.dive_id}, config.link_key,
                mission.start_utc_ns - kClockSlack_ns),
      progress_(planOf(mission)) {
  telemetry::MissionInfo info;
  info.vehicle_name = mission.vehicle_name;
  info.origin = mission.origin;
  info.start_utc_ns = mission.start_utc_ns;
  link_.setMissionInfo(info);
  map_.setMovedObserver([this](const MovingMap::Box& before, const MovingMap::Box& now) {
    for (const MovingMap::Box& box : {before, now})
      if (!box.empty()) link_.noteChanged(box.low.cast<double>(), box.high.cast<double>());
  });
}

void OnboardSystem::consume(std::int64_t arrival_utc_ns, const SensorSample& sample, const OnPair& on_pair) {
  std::visit(
      [&](const auto& s) {
        using T = std::decay_t<decltype(s)>;
        if constexpr (std::is_same_v<T, GpsFix>)
          addFix(nav::FixKind::kGps, s.utc_ns, s.latitude, s.longitude, s.sigma_horizontal);
        else if constexpr (std::is_same_v<T, UsblFix>)
          addFix(nav::FixKind::kUsbl, s.utc_ns, s.latitude, s.longitude, s.sigma_horizontal);
        else if constexpr (std::is_same_v<T, BatterySample>)
          battery_ = s;
        else if constexpr (std::is_same_v<T, MissionProgressSample>)
          reported_progress_ = s.fraction;
        else if constexpr (std::is_same_v<T, ImageEvent>)
          addImage(s, arrival_utc_ns);
        else
          nav_.add(s);
      },
      sample);
  placeEarlyFixes();
  mapPairs(on_pair);
  passTime(arrival_utc_ns);
}

void OnboardSystem::passTime(std::int64_t now_ns) {
  updateTrack(now_ns);
  link_.offerTiles(map_.map(), now_ns);
}

void OnboardSystem::addFix(nav::FixKind kind, std::int64_t utc_ns, double latitude, double longitude,
                           double sigma) {
  const Fix fix = {kind, utc_ns, local_.toLocal({latitude, longitude}), sigma};
  const nav::DeadReckoning& odometry = nav_.core().odometry();
  if (!odometry.initialised()) {
    if (early_fixes_.pushDroppingOldest(fix)) ++fixes_without_odometry_;
  } else if (utc_ns < odometry_began_ns_) {
    placeEarly(fix);
  } else if (const auto T_odom_body = odometry.poseAt(utc_ns)) {
    place(fix, *T_odom_body, odometry.qualityAt(utc_ns).unlocked_s);
  } else {
    ++fixes_without_odometry_;
  }
}

void OnboardSystem::place(const Fix& fix, const SE3& T_odom_body, double unlocked_s) {
  // The GPS antenna is taken at the body's origin: its lever arm is far below a fix's error.
  const SE3 T_odom_sensor =
      fix.kind == nav::FixKind::kUsbl ? T_odom_body * mission_.T_body_usbl : T_odom_body;
  map_.addFix(fix.kind, fix.utc_ns, T_odom_sensor.translation(), fix.north_east, fix.sigma, unlocked_s);
}

void OnboardSystem::placeEarly(const Fix& fix) {
  place(fix, odometry_began_, static_cast<double>(fix.utc_ns - odometry_began_ns_) / kNanosecondsPerSecond);
}

void OnboardSystem::placeEarlyFixes() {
  const nav::DeadReckoning& odometry = nav_.core().odometry();
  if (odometry_began_ns_ != 0 || !odometry.initialised()) return;
  odometry_began_ns_ = odometry.oldestUtcNs();
  odometry_began_ = odometry.poseAt(odometry_began_ns_).value_or(SE3());
  for (std::size_t i = 0; i < early_fixes_.size(); ++i) placeEarly(early_fixes_[i]);
  early_fixes_.clear();
}

void OnboardSystem::addImage(const ImageEvent& event, std::int64_t arrival_utc_ns) {
  const std::uint32_t frame = nav_.addExposure(event.utc_ns, event.side, arrival_utc_ns);
  ImageName& name = image_names_[frame % image_names_.size()];
  name.frame = frame;
  name.text = event.file_name;
  name.exposure_s = event.exposure_s;
}

bool OnboardSystem::readPair(const MappedPair& pair, MapInput& input) const {
  if (source_.features) {
    input.features = source_.features(pair.left_image);
    return input.features != nullptr;
  }
  const auto left = source_.images(pair.left_image, CameraSide::kLeft);
  const auto right = source_.images(pair.right_image, CameraSide::kRight);
  if (!left || !right) return false;
  input.left = *left;
  input.right = *right;
  input.left_exposure_s = pair.left_exposure_s;
  input.right_exposure_s = pair.right_exposure_s;
  return true;
}

bool OnboardSystem::nameImages(const StereoTrigger& trigger, MappedPair& pair) const {
  const ImageName& left = image_names_[trigger.left_frame_id % image_names_.size()];
  const ImageName& right = image_names_[trigger.right_frame_id % image_names_.size()];
  if (left.frame != trigger.left_frame_id || right.frame != trigger.right_frame_id) return false;
  pair.left_image = left.text;
  pair.right_image = right.text;
  pair.left_exposure_s = left.exposure_s;
  pair.right_exposure_s = right.exposure_s;
  return true;
}

void OnboardSystem::mapPairs(const OnPair& on_pair) {
  while (const auto trigger = nav_.core().pollTrigger()) {
    const bool predicted = trigger->pose == StereoTrigger::Pose::kPredicted;
    // A map that does not move waits for the final place.
    if (predicted && !map_.moves()) continue;
    if (trigger->pose == StereoTrigger::Pose::kCorrected && map_.moves()) {
      placePairs(trigger->pair_index, &*trigger, on_pair);
      continue;
    }
    MappedPair pair;
    SeenPair seen;
    if (!seePair(*trigger, pair, seen)) continue;
    if (on_seen_) on_seen_(pair);
    if (waiting_.full()) placePairs(waiting_.front().trigger.pair_index, nullptr, on_pair);
    (void)waiting_.push({*trigger, seen});
    if (!predicted) placePairs(trigger->pair_index, &*trigger, on_pair);
  }
}

bool OnboardSystem::seePair(const StereoTrigger& trigger, MappedPair& pair, SeenPair& seen) {
  if (!mapping_) {
    ++shed_pairs_;
    return false;
  }
  const bool named = nameImages(trigger, pair);
  const PairQuota quota = policy_ ? policy_(trigger, pair) : PairQuota();
  ++pairs_at_level_[std::min<std::size_t>(quota.level, pairs_at_level_.size() - 1)];
  if (quota.drop) {
    ++shed_pairs_;
    return false;
  }
  MapInput input;
  const bool read = named && readPair(pair, input);
  if (observer_) observer_("images");
  if (!read) {
    ++unreadable_images_;
    return false;
  }
  input.pair_index = trigger.pair_index;
  input.utc_ns = trigger.utc_ns;
  input.T_odom_body = trigger.T_odom_body;
  input.quality = trigger.quality;
  input.closures = quota.closures;
  if (quota.feature_share < 1)
    input.max_features = static_cast<int>(quota.feature_share * config_.stereo.max_features);
  if (quota.rebuild_share < 1)
    input.rebuild_meshes = static_cast<int>(quota.rebuild_share * config_.rebuild_meshes);
  if (trigger.altitude_valid) pair.altitude = input.altitude = trigger.altitude;
  last_pair_ns_ = trigger.utc_ns;
  seen = map_.see(input);
  pair.output = seen.output;
  link_.noteMapped(pair.output);
  last_points_ = pair.output.points;
  return true;
}

void OnboardSystem::placePairs(std::uint32_t up_to, const StereoTrigger* last, const OnPair& on_pair) {
  while (!waiting_.empty() && waiting_.front().trigger.pair_index <= up_to) {
    const WaitingPair waiting = waiting_.front();
    waiting_.popFront();
    const bool final_known = last != nullptr && last->pair_index == waiting.trigger.pair_index;
    const StereoTrigger& known = final_known ? *last : waiting.trigger;
    if (on_placing_) on_placing_(waiting.trigger.pair_index);
    last_correction_ = (known.T_odom_body.translation() - waiting.trigger.T_odom_body.translation()).norm();
    MappedPair pair;
    (void)nameImages(waiting.trigger, pair);
    if (waiting.trigger.altitude_valid) pair.altitude = waiting.trigger.altitude;
    pair.output = map_.place(waiting.seen, known.T_odom_body, known.quality);
    on_pair(pair);
  }
}

void OnboardSystem::receiveFrame(std::int64_t now_ns, std::span<const std::uint8_t> frame) {
  const telemetry::DownlinkReceiver::Result received =
      downlink_.accept(now_ns, frame, [&](const telemetry::Acknowledgement& a) {
        return link_.sentLately(a, now_ns, telemetry::DownlinkReceiver::kFresh_s);
      });
  const telemetry::DownlinkContent& content = received.content;
  if (received.verdict == telemetry::DownlinkVerdict::kAccepted ||
      received.verdict == telemetry::DownlinkVerdict::kNoKey)
    link_.noteReceived(now_ns);
  if (content.acknowledgement)
    link_.acknowledge(*content.acknowledgement, now_ns,
                      [this](const fusion::TileKey& square) { map_.noteSent(square); });
  if (content.request) link_.request(*content.request, now_ns, received.counter);
  // The poses are final when the survey is over.
  if (content.fix && !survey_over_) {
    const double sigma = std::isnan(content.fix->sigma) ? kUnstatedFixSigma : content.fix->sigma;
    addFix(nav::FixKind::kUsbl, content.fix->utc_ns, content.fix->latitude * kRadiansPerDegree,
           content.fix->longitude * kRadiansPerDegree, sigma);
  }
}

void OnboardSystem::finish(std::int64_t now_ns, const OnPair& on_pair) {
  survey_over_ = true;
  placePairs(UINT32_MAX, nullptr, on_pair);
  map_.finish();
  link_.offerTiles(map_.map(), now_ns, true);
  if (last_pose_) link_.setStatus(status(now_ns));
}

void OnboardSystem::updateTrack(std::int64_t now_ns) {
  if (now_ns - last_tick_ns_ < kTickInterval_ns) return;
  last_tick_ns_ = now_ns;
  nav_.tick(now_ns);
  const auto pose = nav_.core().odometry().poseAt(nav_.core().odometry().newestUtcNs());
  if (!pose) return;
  if (last_pose_) distance_ += (pose->translation() - last_pose_->translation()).head<2>().norm();
  last_pose_ = pose;
  progress_.update((map_.T_nav_odom() * *pose).translation().head<2>());
  link_.setStatus(status(now_ns));
}

void placeIn(telemetry::Status& status, const SE3& T_nav_body) {
  status.north = T_nav_body.translation().x();
  status.east = T_nav_body.translation().y();
  status.depth = T_nav_body.translation().z();
  const Eigen::Vector3d rpy = T_nav_body.euler();
  status.roll = rpy.x();
  status.pitch = rpy.y();
  status.heading = rpy.z();
}

telemetry::Status OnboardSystem::status(std::int64_t now_ns) const {
  telemetry::Status status;
  const nav::DeadReckoning& odometry = nav_.core().odometry();
  status.utc_ns = odometry.newestUtcNs();
  const auto T_odom_body = odometry.poseAt(status.utc_ns);
  if (T_odom_body) placeIn(status, map_.T_nav_odom() * *T_odom_body);
  status.altitude = odometry.altitude().value_or(telemetry::kAbsent);
  status.speed = odometry.velocityBody().norm();
  if (map_.anchored()) {
    // Before the first keyframe, and without localisation, all of the path counts.
    status.position_sigma = hypotenuse(map_.anchorSigma(), config_.drift_share * distance_);
    if (T_odom_body)
      status.position_sigma =
          map_.positionSigma(status.utc_ns, *T_odom_body, odometry.qualityAt(status.utc_ns))
              .value_or(status.position_sigma);
  }
  const bool has_battery = battery_ && (now_ns - battery_->utc_ns) / kNanosecondsPerSecond < kBatteryOldAfter;
  if (has_battery && battery_->charge) status.battery = *battery_->charge;
  const MapCore::Counters& counters = map_.counters();
  status.pairs_seen = static_cast<std::uint32_t>(counters.pairs + unreadable_images_ + shed_pairs_);
  status.pairs_dropped = static_cast<std::uint32_t>(unreadable_images_ + shed_pairs_ + counters.bad_images +
                                                    counters.pairs_without_points);
  // What the vehicle's own control says counts before what the plan lets guess.
  status.late_cycles = skipped_cycles_;
  // Pairs that cost less than a whole one, or were dropped.
  status.shed_work = static_cast<std::uint32_t>(
      std::accumulate(pairs_at_level_.begin() + 1, pairs_at_level_.end(), std::uint64_t{0}));
  status.mission_progress =
      reported_progress_ ? *reported_progress_ : progress_.fraction().value_or(telemetry::kAbsent);
  const fusion::QuadtreeMap::Counters tiles = map_.map().counters();
  status.pool_refusals = static_cast<std::uint32_t>(tiles.refused + tiles.coarsened);
  status.health = healthFlags(now_ns, tiles);
  return status;
}

std::uint16_t OnboardSystem::healthFlags(std::int64_t now_ns,
                                         const fusion::QuadtreeMap::Counters& tiles) const {
  const NavHealth& nav = nav_.core().health();
  const auto lost = [](double age) { return age < 0 || age > kLostAfter; };
  unsigned flags = program_health_;
  if (lost(nav.dvl_age) || !nav.altitude) flags |= telemetry::kHealthDvlLost;
  if (lost(nav.attitude_age)) flags |= telemetry::kHealthCompassLost;
  if (lost(nav.depth_age)) flags |= telemetry::kHealthDepthLost;
  const double since_pair = static_cast<double>(now_ns - last_pair_ns_) / kNanosecondsPerSecond;
  if (last_pair_ns_ == 0 || since_pair > kNoPairsAfter) flags |= telemetry::kHealthCameraLost;
  if (!map_.anchored()) flags |= telemetry::kHealthNoFix;
  if (tiles.refused > 0) flags |= telemetry::kHealthPoolFull;
  if (tiles.coarsened > 0) flags |= telemetry::kHealthMapCoarsened;
  if (map_.rig().changes() > 0) flags |= telemetry::kHealthSensorContradicted;
  if (const LocalisationCore* localisation = map_.localisation()) {
    const slam::NavigationGraph::Counters& graph = localisation->graph().counters();
    // A compass that has leapt once may be off from then on.
    if (graph.dvl_rejected || graph.compass_jumps > 0) flags |= telemetry::kHealthSensorContradicted;
    const MovingMap::Counters meshes = map_.movingMap().counters();
    const bool full = graph.keyframes_refused + graph.links_refused + graph.fixes_refused > 0 ||
                      meshes.given_up || meshes.meshes_baked_in > 0 ||
                      localisation->features().counters().evicted > 0;
    if (full) flags |= telemetry::kHealthPoolFull;
  }
  const double wanted = kPoorPoints * config_.stereo.max_features;
  if (last_pair_ns_ != 0 && static_cast<double>(last_points_) < wanted) flags |= telemetry::kHealthStereoPoor;
  return static_cast<std::uint16_t>(flags);
}

std::size_t OnboardSystem::nextFrame(std::int64_t now_ns, bool survey_over, std::span<std::uint8_t> out) {
  if (survey_over) link_.offerTiles(map_.map(), now_ns, true);
  return link_.nextFrame(now_ns, out);
}

}  // namespace fathom::onboard
