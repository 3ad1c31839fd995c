#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/kernel/rings/numbered_pool.hpp"
#include "realtime/onboard/localisation/localisation_config.hpp"
#include "realtime/onboard/slots/slot_store.hpp"
#include "recon/calibration/rig_history.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/closure/frame_features.hpp"

namespace fathom::onboard {

// The last frame that became a keyframe. Outside the class, so that std::optional can hold a complete type.
struct LastKeyframe {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;
  closure::Footprint seen;

  static void exchange(auto& archive, auto& self) {
    archive(self.utc_ns, self.T_odom_cam, self.seen.centre, self.seen.radius);
  }
};

// Which stereo frames become keyframes: those that share less than a given part of their footprint with the
// last one, turned, or come late.
class KeyframeSelection {
 public:
  explicit KeyframeSelection(const LocalisationConfig& config) : config_(config) {}

  // Possible further correction of a pose.
  struct Slack {
    double metres = 0, radians = 0;
  };
  // Whether the frame becomes one if it is taken now, or would if its pose were corrected by so little.
  [[nodiscard]] bool due(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen,
                         bool reliable, const Slack& slack = {0, 0}) const;
  // Whether the frame at `T_odom_cam` becomes a keyframe; it then is the last. `seen`: its footprint in odom.
  // `reliable`: odometry measures the distance travelled; if not (no bottom track, an outlying DVL), every
  // frame is taken, so that the images can measure it.
  bool take(std::int64_t utc_ns, const SE3& T_odom_cam, const closure::Footprint& seen, bool reliable = true);

  // For saved state (state_archive.hpp), bit by bit.
  static void exchange(auto& archive, auto& self) { archive(self.last_); }

 private:
  LocalisationConfig config_;
  std::optional<LastKeyframe> last_;
};

// The features of the graph's keyframes: the newest in memory, all in slots on disk. A retired keyframe frees
// its slot. When there are fewer slots than keyframes, the keyframe with the nearest neighbours in time is
// evicted, which loses the least ground. Points are given in the present calibration of the rig.
class KeyframeFeatures {
 public:
  static constexpr std::size_t kNewest = 16;  // kept in memory

  // `slots`: null keeps the newest only. Blocks hold slotBytes() of `max_features`. `rigs` must outlive it.
  KeyframeFeatures(SlotStore* slots, int max_keyframes, int max_features,
                   const calibration::RigHistory& rigs);

  // Features of the next keyframe, counting from 0; `place`: its position, for the eviction above [m]; `rig`:
  // version of the rig that measured them.
  void add(const closure::FrameFeatures& features, const Eigen::Vector3d& place, int rig);
  // Forgets those of a keyframe.
  void retire(int keyframe);

  // Null when there are none (evicted, or the disk failed or returned other bytes than were written). Valid
  // until add() or the second find() after.
  [[nodiscard]] const closure::FrameFeatures* find(int keyframe);

  // Whether every slot in use holds what was written; reads all of them.
  [[nodiscard]] bool slotsHold();
  // Whether find() can be expected to find something.
  [[nodiscard]] bool has(int keyframe) const;

  struct Counters {
    std::uint64_t stored = 0, evicted = 0, write_failures = 0, read_failures = 0;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Saved state (state_archive.hpp), without the content of the slots.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);
  [[nodiscard]] std::span<const int> keyframes() const { return entries_.numbers(); }

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);

  struct Entry {
    std::int32_t slot = -1;
    std::uint32_t crc = 0;  // of the slot's content
    std::int32_t rig = 0;   // version of the rig of its points there
    Eigen::Vector3f place;

    static void exchange(auto& archive, auto& self) { archive(self.slot, self.crc, self.rig, self.place); }
  };
  struct Kept {
    int keyframe = -1;
    std::int32_t rig = 0;  // version of the rig of its points
    closure::FrameFeatures features;
  };
  [[nodiscard]] std::int32_t freeSlot();
  [[nodiscard]] bool readBlock(const Entry& entry);
  [[nodiscard]] const closure::FrameFeatures* asKnownNow(Kept& kept) const;

  SlotStore* slots_;
  const calibration::RigHistory& rigs_;
  rt::NumberedPool<Entry> entries_;   // of keyframes
  std::array<Kept, kNewest> newest_;  // keyframe modulo kNewest
  std::array<Kept, 4> read_;          // from the disk, used in turn
  std::size_t next_read_ = 0;
  std::vector<std::uint8_t> block_;
  std::size_t used_ = 0;            // slots that have been in use
  std::vector<std::int32_t> free_;  // of these, those that are not
  Counters counters_;
};

}  // namespace fathom::onboard
