#pragma once

#include "recon/geometry/state_values.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"
#include "recon/topside/work/saved_bytes.hpp"

// How what the stages hand on to each other is saved and loaded (state_archive.hpp).
namespace fathom::topside {

template <typename T, typename U>
concept Is = std::same_as<std::remove_cvref_t<T>, U>;

}  // namespace fathom::topside

namespace fathom::slam {

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<NavigationLink> auto& link) {
  archive(link.a, link.b, link.T_a_b, link.covariance, link.inliers, link.chi2, link.kept);
}

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<Mounting> auto& m) {
  archive(m.camera_turn, m.camera_turn_sigma, m.dvl_scale, m.dvl_scale_sigma, m.time_offset,
          m.time_offset_sigma, m.steps);
}

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<NavigationGraph::Counters> auto& c) {
  archive(c.keyframes, c.keyframes_refused, c.references, c.odometry_links, c.closures, c.links_contradicting,
          c.links_off, c.links_refused, c.fixes, c.fixes_gated, c.fixes_off, c.fixes_refused,
          c.steps_contradicted, c.steps_left_out, c.compass_jumps, c.attitude_absent, c.depth_absent,
          c.dvl_absent, c.dvl_lies);
}

}  // namespace fathom::slam

namespace fathom::topside {

template <typename Archive>
void exchangeState(Archive& archive, Is<ImagePair> auto& pair) {
  archive(pair.utc_ns, pair.left, pair.right);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<PairList> auto& list) {
  archive(list.pairs, list.left_alone, list.right_alone, list.from_file_names, list.features_only);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<NavigatedPose> auto& pose) {
  archive(pose.utc_ns, pose.T_nav_body, pose.altitude, pose.quality);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<Anchor> auto& anchor) {
  archive(anchor.source, anchor.north, anchor.east, anchor.sigma, anchor.fixes_used, anchor.fixes_rejected);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<FixSeen> auto& fix) {
  archive.enumeration(fix.kind, nav::FixKind::kUsbl);
  archive(fix.utc_ns, fix.north_east, fix.sigma, fix.receiver);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<Navigation> auto& n) {
  archive(n.poses, n.track, n.anchor, n.fixes, n.gps_shift, n.gps_sigma, n.counters, n.skipped_entries,
          n.damaged_entries);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<Survey> auto& survey) {
  archive(survey.list, survey.navigation);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<PairFacts> auto& facts) {
  archive(facts.placed, facts.unreadable, facts.points, facts.corners, facts.features, facts.rejected,
          facts.has_mesh);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<SlamResult::Tried> auto& tried) {
  archive(tried.a, tried.b, tried.accepted);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<SlamResult::Usbl> auto& u) {
  archive(u.sought, u.shift, u.shift_sigma, u.turn, u.turn_sigma);
}

template <typename Archive>
void exchangeState(Archive& archive, Is<SlamResult::Uncertain> auto& u) {
  archive(u.pair, u.T_nav_cam, u.covariance, u.since_first);
}

// Without its stages' seconds, which are not the same twice.
template <typename Archive>
void exchangeState(Archive& archive, Is<SlamResult> auto& slam) {
  archive(slam.poses, slam.odometry, slam.closures, slam.frames, slam.tried, slam.refused,
          slam.crossings_expected, slam.crossings_unverified, slam.unconfirmed, slam.converged,
          slam.uncertain, slam.sensors, slam.mounting, slam.usbl, slam.fixes_kept, slam.fixes_removed,
          slam.moved_rms);
}

}  // namespace fathom::topside
