// The navigation graph as saved state.
#include <algorithm>
#include <limits>

#include "recon/geometry/state_values.hpp"
#include "recon/slam/matrix_state.hpp"
#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("GRPH"), kVersion = 13;

template <typename Archive, typename Quality>
void exchangeQuality(Archive& archive, Quality& quality) {
  archive(quality.seconds, quality.seconds_unlocked, quality.seconds_untilted, quality.calibration_share,
          quality.turn, quality.pressure_sigma);
}

template <typename Archive, typename Counters>
void exchangeCounters(Archive& archive, Counters& c) {
  archive(c.keyframes, c.keyframes_refused, c.keyframes_retired, c.references, c.references_retired,
          c.odometry_links, c.closures, c.links_contradicting, c.links_off, c.links_refused, c.fixes,
          c.fixes_gated, c.fixes_off, c.fixes_refused, c.steps_contradicted, c.steps_left_out,
          c.compass_jumps, c.attitude_absent, c.depth_absent, c.dvl_absent, c.compass_distrusted,
          c.visual_distrusted, c.dvl_lies);
}

bool within(int index, int first, std::size_t size) {
  return index >= first && index < static_cast<int>(size);
}

}  // namespace

template <typename Archive, typename Self>
void NavigationGraph::exchange(Archive& archive, Self& self) {
  archive(self.solver_, self.dvl_);
  archive.bounded(self.changed_, self.changed_.capacity());
  std::uint64_t next = self.next_robust_, newest = self.newest_robust_;
  archive(next, newest, self.anchor_, self.usbl_anchor_, self.gauge_, self.usbl_, self.held_,
          self.jump_waits_, self.heading_, self.seen_, self.velocity_, self.contradictions_, self.slips_,
          self.agreements_, self.rig_, self.curved_, self.insistence_, self.trouble_ns_, self.fix_agreed_ns_,
          self.refused_, self.next_refused_);
  if constexpr (Archive::kLoading) {
    self.next_robust_ = next;
    self.newest_robust_ = newest;
  }
  archive(self.attitude_, self.depth_, self.tide_);
  archive.bounded(self.references_, self.references_.capacity());
  std::uint64_t next_reference = self.next_reference_;
  archive(next_reference, self.reference_credit_, self.jumped_ns_);
  if constexpr (Archive::kLoading) self.next_reference_ = next_reference;
  exchangeCounters(archive, self.counters_);
  archive(self.frames_);
  archive.bounded(self.robust_, self.robust_.capacity());
}

template <typename Archive, typename Self>
void NavigationGraph::exchangeFrame(Archive& archive, Self& frame) {
  archive(frame.utc_ns, frame.T_odom_cam, frame.known, frame.node, frame.step, frame.attitude, frame.drift,
          frame.link, frame.gyro_turn, frame.ungyro_s, frame.leapt, frame.mixed, frame.heading.compass,
          frame.heading.visual, frame.heading.restarts, frame.dvl_lies, frame.step_weight, frame.link_slips,
          frame.counted, frame.waiting, frame.range, frame.seen);
  exchangeQuality(archive, frame.quality);
}

template <typename Archive, typename Self>
void NavigationGraph::exchangeRobust(Archive& archive, Self& robust) {
  archive(robust.from, robust.to, robust.T_from_to, robust.measurement, robust.free_chi2, robust.weight,
          robust.fix, robust.off, robust.insists, robust.straightened_by, robust.curved);
  exchangeSymmetric(archive, robust.spread);
}

void NavigationGraph::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
}

bool NavigationGraph::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] {
    exchange(reader, *this);
    if (reader.ok() && !connect()) reader.fail("the navigation graph contradicts itself");
    if (!reader.ok()) return;
    pullShared();
    while (!shared_.solve(solver_)) continue;
    of_closures_ = pulled_ = false;
  });
}

// Who is where, and whether each is somewhere once.
bool NavigationGraph::connect() {
  retired_.clear();
  std::fill(frame_of_node_.begin(), frame_of_node_.end(), -1);
  std::fill(must_stay_.begin(), must_stay_.end(), 1);
  std::fill(robust_of_.begin(), robust_of_.end(), -1);
  const auto isNode = [&](int node) {
    return within(node, 0, at(solver_.size())) && !solver_.isRetired(node);
  };
  const auto isMeasurement = [&](int k) {
    return within(k, 0, at(solver_.measurements())) && solver_.measurement(k).in_use;
  };
  if (!isNode(0)) return false;
  // The newest keyframes never retire.
  const int newest = keyframes() - 1;
  if (living().empty() ? newest >= 0 : living().back() != newest) return false;
  if (seen_.waits && !has(newest - 1)) return false;
  std::size_t waiting = 0;
  std::int64_t before_ns = std::numeric_limits<std::int64_t>::min();
  for (const int k : living()) {
    const Frame& f = frames_[at(k)];
    const bool good = f.node > 0 && isNode(f.node) && frame_of_node_[at(f.node)] < 0 &&
                      (f.step == -1 || isMeasurement(f.step)) &&
                      (f.attitude == -1 || isMeasurement(f.attitude)) &&
                      (f.drift == -1 || isMeasurement(f.drift)) && (f.link == -1 || isMeasurement(f.link)) &&
                      before_ns <= f.utc_ns;
    if (!good) return false;
    frame_of_node_[at(f.node)] = k;
    must_stay_[at(f.node)] = 0;
    before_ns = f.utc_ns;
    waiting += f.waiting ? 1 : 0;
  }
  if (gauge_ != -1 && !isMeasurement(gauge_)) return false;
  if (gauge_ >= 0) must_stay_[at(solver_.measurement(gauge_).to)] = 1;
  std::vector<int> changed(changed_);
  std::sort(changed.begin(), changed.end());
  if (std::adjacent_find(changed.begin(), changed.end()) != changed.end()) return false;
  const auto waits = [&](int k) { return has(k) && frames_[at(k)].waiting; };
  if (changed.size() != waiting || !std::all_of(changed.begin(), changed.end(), waits)) return false;
  for (std::size_t i = 0; i < robust_.size(); ++i) {
    const Robust& r = robust_[i];
    const bool good = (r.from == kWorld || isNode(r.from)) && isNode(r.to) && isMeasurement(r.measurement) &&
                      robust_of_[at(r.measurement)] < 0 && r.spread.allFinite() &&
                      r.straightened_by.allFinite() && r.factor().information.allFinite();
    if (!good) return false;
    robust_of_[at(r.measurement)] = static_cast<int>(i);
  }
  const auto isReference = [&](const Reference& r) {
    return r.node > 0 && isNode(r.node) && frame_of_node_[at(r.node)] < 0;
  };
  std::vector<int> nodes;
  for (const Reference& r : references_) nodes.push_back(r.node);
  std::sort(nodes.begin(), nodes.end());
  if (std::adjacent_find(nodes.begin(), nodes.end()) != nodes.end()) return false;
  const bool usbl_stands =
      usbl_.node == -1 || (usbl_.node > 0 && isNode(usbl_.node) && frame_of_node_[at(usbl_.node)] < 0 &&
                           !std::binary_search(nodes.begin(), nodes.end(), usbl_.node));
  const auto isPresent = [&](const Reference& r) { return r.node == -1 || isReference(r); };
  return std::all_of(references_.begin(), references_.end(), isReference) && usbl_stands &&
         isPresent(attitude_) && isPresent(depth_) && isPresent(tide_) &&
         (next_robust_ < robust_.size() || next_robust_ == 0) && newest_robust_ <= robust_.size() &&
         next_reference_ <= references_.size() && reference_credit_ >= 0;
}

}  // namespace fathom::slam
