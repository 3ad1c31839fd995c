#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "realtime/kernel/state_archive_fwd.hpp"
#include "telemetry/vehicle/block_queue.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::telemetry {

// What the last frames carried, until there is word of them. A frame is lost when an acknowledgement says so,
// when one that reaches less far back is silent about it, or when one that is older than the frame comes
// later than a round trip after the frame had left. Bounded; nothing is allocated after construction.
class SentFrames {
 public:
  static constexpr std::size_t kFrames = 512;

  // `round_trip_s`: from a frame's end to the latest arrival of an answer to it [s].
  // `expected_burst`: frames lost in a row; 0: each by itself.
  SentFrames(double round_trip_s, double expected_loss, double expected_burst);

  // A frame goes out; its last bit leaves at `left_ns`. Sequence numbers follow each other.
  void add(std::uint16_t sequence, std::int64_t left_ns, std::span<const BlockRef> blocks);

  // So many sequence numbers are passed over: nothing is known of what had them.
  void skip(std::uint16_t count);

  // Called with the blocks of a frame and whether it arrived.
  using Word = std::function<void(std::span<const BlockRef>, bool arrived)>;
  // False: not about these frames (another dive's, or a sender's before it restarted).
  bool acknowledge(const Acknowledgement& a, std::int64_t now_ns, const Word& word);

  // Called with the blocks of frames that are pushed out of the ring without word.
  void onForgotten(std::function<void(std::span<const BlockRef>)> forgotten) {
    forgotten_ = std::move(forgotten);
  }

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
    bool open = false;  // without word
    std::uint16_t sequence = 0;
    std::int64_t left_ns = 0;
    std::size_t blocks = 0;
    std::array<BlockRef, BlockQueue::kMaxBatch> block;
  };
  void learn(bool arrived);

  std::int64_t round_trip_ns_;
  std::vector<Frame> frames_;  // by sequence % kFrames
  std::uint16_t next_ = 0;     // sequence number
  std::size_t held_ = 0;       // frames since the start, at most kFrames
  std::function<void(std::span<const BlockRef>)> forgotten_;
  double loss_;
  double after_lost_;  // share of lost frames among those after a lost one
  bool last_lost_ = false, any_word_ = false;
  Counters counters_;
};

}  // namespace fathom::telemetry
