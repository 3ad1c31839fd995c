#include "recon/topside/assemble/dive_tables_input.hpp"

#include <algorithm>
#include <numeric>

#include "recon/products/tables/dive_tables.hpp"

namespace fathom::topside {
namespace {

// How localisation moved a pose in nav.
struct Correction {
  std::int64_t utc_ns = 0;
  SE3 moved;
};

std::vector<Correction> correctionsOf(const std::vector<NavigatedPose>& before,
                                      const std::vector<NavigatedPose>& after) {
  std::vector<Correction> out;
  for (std::size_t k = 0; k < before.size(); ++k)
    if (before[k].T_nav_body && after[k].T_nav_body)
      out.push_back({before[k].utc_ns, *after[k].T_nav_body * before[k].T_nav_body->inverse()});
  return out;
}

// `moved` turns about nav's origin, which may be far away: the vehicle's own place and attitude are moved
// instead.
SE3 correctedAt(const std::vector<Correction>& all, std::int64_t utc_ns, const SE3& pose) {
  if (all.empty()) return pose;
  const auto next = std::lower_bound(all.begin(), all.end(), utc_ns,
                                     [](const Correction& c, std::int64_t t) { return c.utc_ns < t; });
  if (next == all.begin()) return next->moved * pose;
  const auto last = next - 1;
  if (next == all.end()) return last->moved * pose;
  const double s =
      static_cast<double>(utc_ns - last->utc_ns) / static_cast<double>(next->utc_ns - last->utc_ns);
  return interpolate(last->moved * pose, next->moved * pose, s);
}

std::optional<double> altitudeOf(const FusedPair& pair) {
  return pair.altitude > 0 ? std::optional(pair.altitude) : std::nullopt;
}

}  // namespace

std::vector<DiveTrackPoint> trackOf(Dive& dive, const FuseResult& fused, const WaterLog& water) {
  const Navigation& navigation = dive.survey().navigation;
  const std::vector<Correction> moved = correctionsOf(navigation.poses, dive.poses());
  std::vector<DiveTrackPoint> track;
  if (!dive.input().navigated) {
    const FusedPair* last = nullptr;
    for (const FusedPair& pair : fused.pairs) {
      if (last != nullptr && last->part != pair.part)
        track.push_back({std::midpoint(last->pair.utc_ns, pair.pair.utc_ns), {}, {}, "", {}});
      track.push_back({pair.pair.utc_ns, pair.T_nav_body, altitudeOf(pair), "", {}});
      last = &pair;
    }
    return track;
  }
  for (const NavigatedPose& pose : navigation.track) {
    DiveTrackPoint point;
    point.utc_ns = pose.utc_ns;
    point.altitude = pose.altitude;
    if (pose.T_nav_body) point.T_nav_body = correctedAt(moved, pose.utc_ns, *pose.T_nav_body);
    point.water = water.at(pose.utc_ns, point.T_nav_body ? point.T_nav_body->translation().z() : 0);
    track.push_back(std::move(point));
  }
  const std::vector<ImagePair>& pairs = dive.survey().list.pairs;
  nameStages(track, pairs.front().utc_ns, pairs.back().utc_ns);
  return track;
}

std::vector<ImageRow> imageRowsOf(Dive& dive, const FuseResult& fused, const WaterLog& water) {
  const MissionInput& input = dive.input();
  std::vector<ImageRow> rows;
  for (const FusedPair& pair : fused.pairs) {
    ImageRow row;
    row.left = pair.pair.left;
    row.right = pair.pair.right;
    if (input.timed()) row.utc_ns = pair.pair.utc_ns;
    row.T_nav_body = pair.T_nav_body;
    row.T_nav_cam = pair.T_nav_cam;
    row.altitude = altitudeOf(pair);
    row.footprint = footprintOnPlane(input.rig.left, pair.T_nav_cam, pair.range);
    row.water = water.at(pair.pair.utc_ns, row.T_nav_body.translation().z());
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace fathom::topside
