// The navigation graph as saved state.
#include <algorithm>

#include "recon/geometry/state_values.hpp"
#include "recon/slam/navigation_graph.hpp"

namespace fathom::slam {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("GRPH"), kVersion = 2;

template <typename Archive, typename Quality>
void exchangeQuality(Archive& archive, Quality& quality) {
  archive(quality.seconds, quality.seconds_unlocked, quality.seconds_untilted, quality.calibration_share,
          quality.lever);
}

template <typename Archive, typename Reference>
void exchangeReference(Archive& archive, Reference& reference) {
  archive(reference.node, reference.utc_ns, reference.heading);
}

template <typename Archive, typename Counters>
void exchangeCounters(Archive& archive, Counters& c) {
  archive(c.keyframes, c.keyframes_refused, c.references, c.odometry_links, c.closures, c.links_contradicting,
          c.links_off, c.links_refused, c.fixes, c.fixes_gated, c.fixes_off, c.fixes_refused,
          c.steps_contradicted, c.steps_left_out, c.compass_jumps, c.attitude_absent, c.depth_absent,
          c.dvl_absent, c.compass_distrusted, c.visual_distrusted, c.dvl_lies);
}

bool within(int index, int first, std::size_t size) {
  return index >= first && index < static_cast<int>(size);
}

}  // namespace

template <typename Archive, typename Self>
void NavigationGraph::exchange(Archive& archive, Self& self) {
  archive(self.solver_, self.dvl_);
  archive.bounded(self.frame_of_node_, self.frame_of_node_.capacity());
  archive.bounded(self.changed_, self.changed_.capacity());
  std::uint64_t next = self.next_robust_, newest = self.newest_robust_;
  archive(next, newest, self.shift_, self.shift_sigma_, self.jump_waits_, self.heading_, self.seen_,
          self.velocity_, self.contradictions_, self.slips_, self.agreements_, self.insistence_,
          self.trouble_ns_, self.fix_agreed_ns_, self.refused_, self.next_refused_);
  if constexpr (Archive::kLoading) {
    self.next_robust_ = next;
    self.newest_robust_ = newest;
  }
  exchangeReference(archive, self.attitude_);
  exchangeReference(archive, self.depth_);
  exchangeCounters(archive, self.counters_);
  archive.bounded(self.frames_, self.frames_.capacity());
  archive.bounded(self.robust_, self.robust_.capacity());
}

template <typename Archive, typename Self>
void NavigationGraph::exchangeFrame(Archive& archive, Self& frame) {
  archive(frame.utc_ns, frame.T_odom_cam, frame.known, frame.node, frame.step, frame.attitude, frame.drift,
          frame.link, frame.gyro_turn, frame.ungyro_s, frame.leapt, frame.mixed, frame.heading.compass,
          frame.heading.visual, frame.heading.restarts, frame.dvl_lies, frame.link_slips, frame.waiting);
  exchangeQuality(archive, frame.quality);
}

template <typename Archive, typename Self>
void NavigationGraph::exchangeRobust(Archive& archive, Self& robust) {
  auto& f = robust.factor;
  archive(f.from, f.to, f.T_from_to, robust.measurement, robust.free_chi2, robust.weight, robust.fix,
          robust.off, robust.insists);
  // A link's information follows from its covariance; a fix has none.
  if (robust.fix)
    archive(f.information);
  else
    archive(robust.covariance);
  if constexpr (Archive::kLoading)
    if (!robust.fix) f = linkFactor(f.from, f.to, f.T_from_to, robust.covariance);
}

void NavigationGraph::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
}

bool NavigationGraph::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] {
    exchange(reader, *this);
    if (reader.ok() && !isWhole()) reader.fail("the navigation graph contradicts itself");
  });
}

bool NavigationGraph::isWhole() const {
  const auto nodes = static_cast<std::size_t>(solver_.size()),
             measurements = static_cast<std::size_t>(solver_.measurements());
  if (nodes == 0 || frame_of_node_.size() != nodes) return false;
  for (int node = 0; node < solver_.size(); ++node)
    if (solver_.isRetired(node)) return false;
  for (const int k : frame_of_node_)
    if (!within(k, -1, frames_.size())) return false;
  std::size_t waiting = 0;
  for (std::size_t k = 0; k < frames_.size(); ++k) {
    const Frame& f = frames_[k];
    const bool good = within(f.node, 1, nodes) && within(f.step, -1, measurements) &&
                      within(f.attitude, -1, measurements) && within(f.drift, -1, measurements) &&
                      within(f.link, -1, measurements) && frame_of_node_[at(f.node)] == static_cast<int>(k) &&
                      (k == 0 || frames_[k - 1].utc_ns <= f.utc_ns);
    if (!good) return false;
    waiting += f.waiting ? 1 : 0;
  }
  std::vector<bool> met(frames_.size());
  for (const int k : changed_) {
    if (!within(k, 0, frames_.size()) || !frames_[at(k)].waiting || met[at(k)]) return false;
    met[at(k)] = true;
  }
  const auto good = [&](const Robust& r) {
    return within(r.factor.from, kWorld, nodes) && within(r.factor.to, 0, nodes) &&
           within(r.measurement, 0, measurements) && r.factor.information.allFinite() &&
           r.covariance.allFinite();
  };
  return changed_.size() == waiting && std::all_of(robust_.begin(), robust_.end(), good) &&
         (next_robust_ < robust_.size() || next_robust_ == 0) && newest_robust_ <= robust_.size() &&
         within(attitude_.node, -1, nodes) && within(depth_.node, -1, nodes);
}

}  // namespace fathom::slam
