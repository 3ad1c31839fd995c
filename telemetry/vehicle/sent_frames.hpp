#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::telemetry {

// The blocks that the last frames carried, until the outcome of each is known. A frame is lost when an
// acknowledgement says so, when an acknowledgement of the latest frames does not reach back to it, or when an
// acknowledgement older than the frame comes later than a round trip after the frame left. Bounded; nothing
// is allocated after construction.
class SentFrames {
 public:
  static constexpr std::size_t kFrames = 512;
  static constexpr Version kFirst = 0x10000;  // the least first version, so that no block's version is 0

  // `round_trip_s`: from a frame's end to the latest arrival of an answer to it [s]. `expected_burst`: frames
  // lost in a row; 0: each by itself.
  SentFrames(double round_trip_s, double expected_loss, double expected_burst, Version first = kFirst);

  // Adds the next frame; its last bit leaves at `left_ns`.
  void add(std::int64_t left_ns, std::span<const BlockRef> blocks);
  [[nodiscard]] Version next() const { return next_; }  // frame
  // The frames from this one on are one modem frame; its last bit leaves at `left_ns`.
  void leftTogether(Version first, std::int64_t left_ns);

  // Skips versions of frames that are unknown.
  void skip(Version count);

  // The newest frame of an acknowledgement; nullopt for one of other frames (of another dive, or from before
  // a restart).
  [[nodiscard]] std::optional<Version> newestOf(const Acknowledgement& a) const;
  // Called with a frame, its blocks and whether it arrived.
  using Word = std::function<void(Version, std::span<const BlockRef>, bool arrived)>;
  // `newest`: as newestOf() gives it.
  void acknowledge(const Acknowledgement& a, Version newest, std::int64_t now_ns, const Word& word);
  // When a frame's last bit left; nullopt for a frame before oldest().
  [[nodiscard]] std::optional<std::int64_t> leftAt(Version version) const;
  // The last known outcome of a frame; nullopt while it has none, or before oldest().
  [[nodiscard]] std::optional<bool> wordOf(Version version) const;
  void countForeign() { ++counters_.foreign; }
  // The oldest frame that is still known.
  [[nodiscard]] Version oldest() const { return next_ - static_cast<Version>(held_); }

  // Share of frames lost and mean length of a burst, as acknowledged lately; as expected before the first
  // acknowledgement.
  [[nodiscard]] double loss() const { return loss_; }
  [[nodiscard]] double burst() const;
  [[nodiscard]] std::size_t memoryBytes() const { return frames_.size() * sizeof(Frame) + sizeof(*this); }

  struct Counters {
    std::uint64_t arrived = 0, lost = 0;
    std::uint64_t acknowledgements = 0, foreign = 0;  // foreign: not about these frames
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // In link_scheduler_state.cpp, bit by bit; `squares`: of the queue whose blocks they carried.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, std::size_t squares);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Frame {
    bool open = false;     // without an outcome
    bool arrived = false;  // by the last acknowledgement
    std::int64_t left_ns = 0;
    std::size_t blocks = 0;
    std::array<BlockRef, BlockQueue::kMaxBatch> block;
  };
  void learn(bool arrived);

  std::int64_t round_trip_ns_;
  std::vector<Frame> frames_;  // by version % kFrames
  Version first_, next_;
  std::size_t held_ = 0;             // frames since the start, at most kFrames
  Version newest_acknowledged_ = 0;  // the newest frame of any acknowledgement
  double loss_;
  double after_lost_;  // share of lost frames among those after a lost one
  bool last_lost_ = false, any_word_ = false;
  Counters counters_;
};

}  // namespace fathom::telemetry
