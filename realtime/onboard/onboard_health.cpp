#include <algorithm>

#include "realtime/base/bytes/state_archive.hpp"
#include "realtime/onboard/onboard_system.hpp"
#include "recon/geometry/state_values.hpp"

namespace fathom::onboard {

namespace {

using HealthRow = std::vector<std::pair<std::string, double>>;

void addLink(const telemetry::LinkScheduler::Counters& l, HealthRow& row) {
  const auto add = [&](const char* name, auto value) {
    row.emplace_back(std::string("link_") + name, static_cast<double>(value));
  };
  add("frames", l.frames);
  add("bytes", l.bytes);
  add("map_frames", l.map_frames);
  add("repair_frames", l.repair_frames);
  add("turns", l.turns);
  add("acknowledgements", l.acknowledgements);
  add("requests", l.requests);
  add("requests_refused", l.requests_refused);
  add("frames_arrived", l.frames_arrived);
  add("frames_lost", l.frames_lost);
  add("loss", l.loss);
  add("blocks_sent", l.blocks.sent);
  add("blocks_resent", l.blocks.resent);
  add("blocks_updated", l.blocks.updated);
  add("blocks_waiting", l.blocks_waiting);
  add("blocks_in_flight", l.blocks_in_flight);
  add("blocks_evicted", l.blocks.evicted);
  add("blocks_unsendable", l.blocks.unsendable);
  add("rate_bps", l.rate_bps);
  add("periods_stretched", l.periods_stretched);
}

void addClosureSearch(const OnlineClosureSearch::Counters& s, HealthRow& row) {
  const auto add = [&](const std::string& name, auto value) {
    row.emplace_back("slam_" + name, static_cast<double>(value));
  };
  add("predictions", s.predictions);
  add("candidates", s.proposed);
  add("candidates_stale", s.stale);
  add("candidates_dropped", s.dropped);
  add("candidates_waiting", s.waiting);
  add("registrations", s.registrations);
  add("registrations_accepted", s.accepted);
  for (std::size_t k = 1; k < closure::kRefusals; ++k) {
    std::string name(closure::nameOf(static_cast<closure::Refusal>(k)));
    std::replace(name.begin(), name.end(), ' ', '_');
    add("refused_" + name, s.refused[k]);
  }
  add("closures_unconfirmed", s.unconfirmed_now);
  add("closures_given_up", s.unconfirmed);
  add("closures_confirmed", s.confirmed);
}

}  // namespace

void OnboardSystem::addDownlink(std::vector<std::pair<std::string, double>>& row) const {
  const telemetry::DownlinkReceiver::Counters& c = downlink_.counters();
  const auto add = [&](std::string name, std::uint64_t value) {
    std::replace(name.begin(), name.end(), '-', '_');
    row.emplace_back("downlink_" + name, static_cast<double>(value));
  };
  for (std::size_t v = 0; v < telemetry::kDownlinkVerdicts; ++v)
    add(telemetry::name(static_cast<telemetry::DownlinkVerdict>(v)), c.verdicts[v]);
  add("acknowledgements", c.acknowledgements);
  add("fixes", c.fixes);
  add("requests", c.requests);
  add("repeated_requests", c.repeated_requests);
}

void OnboardSystem::addLocalisation(std::vector<std::pair<std::string, double>>& row) const {
  const LocalisationCore* localisation = map_.localisation();
  if (localisation == nullptr) return;
  const auto add = [&](std::string name, auto value) {
    row.emplace_back("slam_" + std::move(name), static_cast<double>(value));
  };
  const LocalisationCore::Counters c = localisation->counters();
  const slam::NavigationGraph::Counters& g = localisation->graph().counters();
  add("keyframes", g.keyframes);
  add("keyframes_refused", g.keyframes_refused);
  add("keyframes_retired", g.keyframes_retired);
  add("references", g.references);
  add("references_retired", g.references_retired);
  add("frames_without_features", c.frames_without_features);
  add("odometry_links", g.odometry_links);
  add("odometry_refused", c.odometry_refused);
  add("odometry_second_tries", c.odometry_second_tries);
  add("odometry_surprises", c.odometry_surprises);
  add("odometry_renewed", c.odometry_renewed);
  add("steps_contradicted", g.steps_contradicted);
  add("steps_left_out", g.steps_left_out);
  add("dvl_lies", g.dvl_rejected);
  const slam::DvlCalibration& dvl = localisation->graph().dvl();
  add("dvl_scale", dvl.scale());
  add("dvl_heading_rad", dvl.heading());
  add("dvl_calibrations", dvl.restarts());
  add("dvl_absent", g.dvl_absent);
  add("attitude_absent", g.attitude_absent);
  add("depth_absent", g.depth_absent);
  add("compass_jumps", g.compass_jumps);
  add("deviation_rad", localisation->graph().deviation());
  const SE3 usbl = localisation->graph().usblCorrection();
  add("usbl_north_m", usbl.translation().x());
  add("usbl_east_m", usbl.translation().y());
  add("usbl_turn_rad", usbl.euler().z());
  add("sea_height_m", localisation->graph().seaHeight());
  add("closures", g.closures);
  add("links_contradicting", g.links_contradicting);
  add("links_off", g.links_off);
  add("links_refused", g.links_refused);
  add("fixes", g.fixes);
  add("fixes_gated", g.fixes_gated);
  add("fixes_off", g.fixes_off);
  add("fixes_refused", g.fixes_refused);
  add("fixes_dropped", c.fixes_dropped);
  add("fixes_waiting", c.fixes_waiting);
  addClosureSearch(localisation->closures().counters(), row);
  const KeyframeFeatures::Counters& f = localisation->features().counters();
  add("slots_stored", f.stored);
  add("slots_given_way", f.evicted);
  add("slot_write_failures", f.write_failures);
  add("slot_read_failures", f.read_failures);
  const MovingMap::Counters m = map_.movingMap().counters();
  add("changes_waiting", c.changes_waiting);
  add("map_rebuilds", m.rebuilds);
  add("map_meshes_fused_again", m.meshes_fused_again);
  add("map_meshes_waiting", m.waiting);
  add("map_meshes_lost", m.meshes_lost);
  add("map_meshes_baked_in", m.meshes_baked_in);
  add("map_given_up", m.given_up);
  add("position_sigma_m", localisation->positionSigma());
  const slam::IncrementalSolver& solver = localisation->graph().solver();
  add("factor_left_out", solver.leftOut());
  add("factor_store_share",
      static_cast<double>(solver.factorBlocks()) / static_cast<double>(solver.factorStore()));
  add("graph_bytes", localisation->graph().memoryBytes());
  add("memory_bytes", localisation->memoryBytes());
}

std::vector<std::pair<std::string, double>> OnboardSystem::health() const {
  std::vector<std::pair<std::string, double>> row;
  const auto add = [&](std::string name, auto value) {
    row.emplace_back(std::move(name), static_cast<double>(value));
  };
  const NavHealth& nav = nav_.core().health();
  add("dvl_age_s", nav.dvl_age);
  add("attitude_age_s", nav.attitude_age);
  add("depth_age_s", nav.depth_age);
  add("odometry_age_s", nav.odometry_age);
  for (const NavHealth::Counter& counter : nav.counters)
    add("nav_" + std::string(counter.name), counter.value);
  const nav::DeadReckoning& odometry = nav_.core().odometry();
  add("pressure_sigma_m", odometry.qualityAt(odometry.newestUtcNs()).pressure_sigma);
  add("left_clock_lost_s", nav_.leftClock().lost());
  add("right_clock_lost_s", nav_.rightClock().lost());
  add("camera_clock_leaps", nav_.leftClock().leaps() + nav_.rightClock().leaps());
  const nav::PositionAnchor::Counters& fixes = map_.anchor().counters();
  add("gps_fixes", fixes.gps);
  add("usbl_fixes", fixes.usbl);
  add("fixes_refused", fixes.refused);
  add("fixes_without_odometry", fixes_without_odometry_);
  const MapCore::Counters& m = map_.counters();
  add("pairs", m.pairs);
  add("pairs_without_points", m.pairs_without_points);
  add("pairs_waiting", waiting_.size());
  add("pair_correction_m", last_correction_);
  add("pairs_unreadable", unreadable_images_);
  add("pairs_shed", shed_pairs_);
  for (std::size_t level = 1; level < pairs_at_level_.size(); ++level)
    add("pairs_at_level_" + std::to_string(level), pairs_at_level_[level]);
  add("bad_images", m.bad_images);
  add("points", m.points);
  add("rejected_no_track", m.rejected.no_track);
  add("rejected_left_right", m.rejected.left_right);
  add("rejected_epipolar", m.rejected.epipolar);
  add("rejected_range", m.rejected.range);
  add("rejected_outlier", m.rejected.outlier);
  add("rejected_fish", m.rejected.fish);
  const calibration::RigWatch& rig = map_.rig();
  add("rig_changes", rig.changes());
  const calibration::RigChange change = rig.change();
  for (int axis = 0; axis < 3; ++axis)
    add("rig_turned_" + std::string(1, "xyz"[axis]) + "_rad", change.rotation(axis));
  add("rig_focal_longer", change.focal);
  add("rig_k1_more", change.radial);
  add("rig_range_scale", rig.rangeCorrected().scale);
  add("rig_range_per_m", rig.rangeCorrected().per_metre);
  add("rig_versions", rig.history().newest());
  const lighting::LightingModel::Report light = map_.leftLight().report();
  add("lighting_model", static_cast<int>(light.used));
  add("lighting_images", light.images);
  add("lighting_outlier_share", light.outlier_share);
  const fusion::QuadtreeMap::Counters q = map_.map().counters();
  add("map_tiles", q.tiles_used);
  add("map_tiles_high_water", q.tiles_high_water);
  add("map_memory_bytes", q.memory_bytes);
  add("map_observations", q.observations);
  add("map_outvoted", q.outvoted);
  add("map_coarsened", q.coarsened);
  add("map_refused", q.refused);
  addLocalisation(row);
  addLink(link_.counters(), row);
  addDownlink(row);
  return row;
}

// Saved state of the system as a whole; the cores' own is theirs.
template <typename Archive, typename Self>
void OnboardSystem::exchange(Archive& archive, Self& self) {
  for (auto& name : self.image_names_) archive(name.frame, name.text, name.exposure_s);
  archive(self.last_pose_, self.distance_, self.program_health_, self.skipped_cycles_, self.shed_pairs_,
          self.pairs_at_level_, self.unreadable_images_, self.fixes_without_odometry_);
  archive(self.early_fixes_, self.odometry_began_);
  archive.instants(self.last_pair_ns_, self.last_tick_ns_, self.odometry_began_ns_);
  archive(self.last_points_, self.survey_over_, self.reported_progress_, self.waiting_,
          self.last_correction_);
  bool battery = self.battery_.has_value();
  archive(battery);
  if constexpr (Archive::kLoading) {
    self.battery_.reset();
    if (battery) self.battery_.emplace();
  }
  if (!self.battery_) return;
  archive.instants(self.battery_->utc_ns);
  archive(self.battery_->voltage, self.battery_->current, self.battery_->charge);
}

void OnboardSystem::save(rt::StateWriter& writer) const {
  // Navigation first and by itself: the hard tier begins with it.
  writer(nav_);
  writer(map_, link_, downlink_);
  writer.section(rt::stateTag("PROG"), 1, [&] { writer(progress_); });
  writer.section(rt::stateTag("ONBD"), 4, [&] { exchange(writer, *this); });
}

bool OnboardSystem::load(rt::StateReader& reader) {
  return reader(nav_) && reader(map_, link_, downlink_) &&
         reader.section(rt::stateTag("PROG"), 1, [&] { reader(progress_); }) &&
         reader.section(rt::stateTag("ONBD"), 4, [&] { exchange(reader, *this); });
}

}  // namespace fathom::onboard
