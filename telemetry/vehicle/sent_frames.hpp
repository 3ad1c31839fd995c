#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::telemetry {

// What the last frames carried, until there is word of them. A frame is lost when an acknowledgement says so,
// when one of the latest frames that reaches less far back is silent about it, or when one that is older than
// the frame comes later than a round trip after the frame had left. Bounded; nothing is allocated after
// construction.
class SentFrames {
 public:
  static constexpr std::size_t kFrames = 512;
  static constexpr Version kFirst = 0x10000;  // the least: no block's version is 0, whatever is taken from it

  // `round_trip_s`: from a frame's end to the latest arrival of an answer to it [s].
  // `expected_burst`: frames lost in a row; 0: each by itself.
  SentFrames(double round_trip_s, double expected_loss, double expected_burst, Version first = kFirst);

  // The next frame goes out; its last bit leaves at `left_ns`.
  void add(std::int64_t left_ns, std::span<const BlockRef> blocks);
  [[nodiscard]] Version next() const { return next_; }  // frame
  // The frames from this one on were one modem frame, whose last bit leaves at `left_ns`.
  void leftTogether(Version first, std::int64_t left_ns);

  // So many frames are passed over: nothing is known of what had their numbers.
  void skip(Version count);

  // The frame that an acknowledgement names as the newest; nothing for one that is not about these frames
  // (another dive's, or a sender's before it restarted).
  [[nodiscard]] std::optional<Version> newestOf(const Acknowledgement& a) const;
  // Called with a frame, its blocks and whether it arrived.
  using Word = std::function<void(Version, std::span<const BlockRef>, bool arrived)>;
  // `newest`: as newestOf() gives it.
  void acknowledge(const Acknowledgement& a, Version newest, std::int64_t now_ns, const Word& word);
  // When a frame's last bit left; nothing for one that is known no more.
  [[nodiscard]] std::optional<std::int64_t> leftAt(Version version) const;
  // The last word of a frame; nothing where there is none, or it is known no more.
  [[nodiscard]] std::optional<bool> wordOf(Version version) const;
  void countForeign() { ++counters_.foreign; }
  // Frames before this one are known no more.
  [[nodiscard]] Version oldest() const { return next_ - static_cast<Version>(held_); }

  // Share of frames lost and mean length of a burst, as acknowledged lately; as expected before any word.
  [[nodiscard]] double loss() const { return loss_; }
  [[nodiscard]] double burst() const;
  [[nodiscard]] std::size_t memoryBytes() const { return frames_.size() * sizeof(Frame) + sizeof(*this); }

  struct Counters {
    std::uint64_t arrived = 0, lost = 0;
    std::uint64_t acknowledgements = 0, foreign = 0;  // foreign: not about these frames
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

  // In link_state.cpp, bit by bit; `squares`: of the queue whose blocks they carried.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, std::size_t squares);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Frame {
    bool open = false;     // without word
    bool arrived = false;  // by the last word
    std::int64_t left_ns = 0;
    std::size_t blocks = 0;
    std::array<BlockRef, BlockQueue::kMaxBatch> block;
  };
  void learn(bool arrived);

  std::int64_t round_trip_ns_;
  std::vector<Frame> frames_;  // by version % kFrames
  Version first_, next_;
  std::size_t held_ = 0;  // frames since the start, at most kFrames
  Version heard_ = 0;     // the newest frame of any acknowledgement
  double loss_;
  double after_lost_;  // share of lost frames among those after a lost one
  bool last_lost_ = false, any_word_ = false;
  Counters counters_;
};

}  // namespace fathom::telemetry
