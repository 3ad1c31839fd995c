#pragma once

#include <algorithm>
#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "realtime/base/bytes/crc32.hpp"
#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/wire/frame.hpp"

namespace fathom::telemetry {

// Repair frames: systematic Reed-Solomon over GF(2^8) with a Cauchy matrix (Bloemer et al. 1995, "An
// XOR-based erasure-resilient coding scheme"), so that any k of a group's k + r frames recover all k.
//
// A group is up to kMaxGroup frames with consecutive sequence numbers. Member j counts as a symbol: u8 length
// of its payload + 1, the payload, zeros up to the longest member; a member that is no map packet counts as
// all zeros (status and track are out of date by the time they could be repaired). Row r of the matrix has 1
// / ((kMaxGroup + r) xor j) in column j.
//
// Payload of a repair frame, whose header carries the sequence number of member 0: u8 k - 1, u8 r, the row's
// symbol.
inline constexpr int kMaxGroup = 64;
inline constexpr int kMaxRepairRows = 256 - kMaxGroup;
inline constexpr std::size_t kRepairHeadBytes = 2;
inline constexpr std::size_t kMaxSymbolBytes = kMaxFrameBytes - kFrameOverhead - kRepairHeadBytes;
// A map packet must be this much shorter than a frame's payload to be repairable by frames of that size.
inline constexpr std::size_t kRepairMargin = kRepairHeadBytes + 1;

// Digest of a group, from its symbols one after the other: begins with 0, ends with groupDigest(). All repair
// frames of a group carry it in their tags (DecodedFrame::group), so that frames of two groups are never
// solved as one, and what was repaired is what was sent.
[[nodiscard]] inline std::uint32_t digestSymbol(std::uint32_t before, std::span<const std::uint8_t> symbol) {
  return crc32(symbol, before);
}
[[nodiscard]] constexpr std::uint8_t groupDigest(std::uint32_t digest) {
  return static_cast<std::uint8_t>(digest ^ digest >> 8 ^ digest >> 16 ^ digest >> 24);
}

// Writes a member's symbol, padded to symbol.size(); false if the payload does not fit.
[[nodiscard]] inline bool makeSymbol(std::span<const std::uint8_t> map_payload, bool is_map,
                                     std::span<std::uint8_t> symbol) {
  std::fill(symbol.begin(), symbol.end(), std::uint8_t{0});
  if (!is_map) return true;
  if (map_payload.size() + 1 > symbol.size() || map_payload.size() >= 255) return false;
  symbol[0] = static_cast<std::uint8_t>(map_payload.size() + 1);
  std::copy(map_payload.begin(), map_payload.end(), symbol.begin() + 1);
  return true;
}

// Repair frames for a group of k members so that all of it is known with probability 0.99 when each frame is
// lost with probability `loss`, in bursts of `burst` frames in the mean (1 / (1 - loss): independently).
// Normal approximation of what arrives; the variance of a Gilbert-Elliott channel is (1 + c) / (1 - c) times
// that of independent losses, c = 1 - 1 / burst - loss / (burst (1 - loss)).
[[nodiscard]] int repairRows(int k, double loss, double burst);

// Makes repair frames for frames that are not acknowledged. Frames form groups in the
// order in which they are sent; the repair frames of a closed group are spread over the time in which the
// next one is sent, taking turns with those of other groups, so that a burst takes little of any one.
// Bounded: when kGroups are waiting, the one with the fewest frames left is evicted. Nothing is allocated
// after construction.
class RepairEncoder {
 public:
  static constexpr int kGroups = 4;

  RepairEncoder();

  // Adds a frame that was sent; called for every version in turn. `loss`, `burst`: as expected now.
  void source(Version version, std::span<const std::uint8_t> payload, bool is_map, double loss, double burst);
  // Closes the open group, when sending pauses.
  void close(double loss, double burst);
  // Drops all groups: everything has arrived, or will be sent again by itself.
  void clear();

  // Whether a repair frame should go before the next frame.
  [[nodiscard]] bool due() const { return pending_ > 0 && credit_ >= 1; }
  [[nodiscard]] bool pending() const { return pending_ > 0; }
  [[nodiscard]] bool open() const { return open_.k > 0; }
  struct Row {
    std::size_t bytes = 0;   // of the payload; 0: none is pending
    Version first = 0;       // of the group, for the header
    std::uint8_t group = 0;  // its digest
  };
  // Writes the next repair frame's payload.
  [[nodiscard]] Row next(std::span<std::uint8_t> out);
  [[nodiscard]] std::size_t memoryBytes() const;

  // In link_scheduler_state.cpp, bit by bit.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  struct Group {
    Version first = 0;
    int k = 0, rows = 0, wanted = 0;  // wanted: rows to be sent in all
    bool has_map = false;
    std::size_t symbol_bytes = 0;
    std::array<std::array<std::uint8_t, kMaxSymbolBytes>, kMaxGroup> symbol{};
  };

  Group open_;
  std::vector<Group> closed_;  // kGroups, used where rows < wanted
  std::size_t turn_ = 0;
  int pending_ = 0;                 // rows of closed groups
  double credit_ = 0, spread_ = 0;  // repair frames due; and gained by each frame
};

// Recovers lost map packets from repair frames. Keeps the last kWindow frames and the
// repair frames of kGroups groups; when full it evicts the oldest. Takes any bytes that passed a frame's tag.
// Nothing is allocated after construction; one solve() has at most kMaxGroup unknowns.
class RepairDecoder {
 public:
  static constexpr int kWindow = 512;  // frames
  static constexpr int kGroups = 8;

  RepairDecoder();
  void clear();

  // Adds a received frame that has a sequence number; `is_map`: a map packet, otherwise its payload does not
  // matter. Newer frames replace those that leave the window.
  void source(std::uint16_t sequence, std::span<const std::uint8_t> payload, bool is_map);
  enum class Taken { kTaken, kDuplicate, kInvalid };
  // Adds a repair frame's payload; `first`: the sequence number in its header; `digest`: of its group, if it
  // has one.
  Taken repair(std::uint16_t first, std::span<const std::uint8_t> payload,
               std::optional<std::uint8_t> digest = {});

  // Solves every group that can be solved now and calls `give` for every map packet that was missing.
  void solve(const std::function<void(std::uint16_t sequence, std::span<const std::uint8_t> payload)>& give);

  struct Counters {
    std::uint64_t solved = 0;        // groups with something missing
    std::uint64_t evicted = 0;       // groups evicted unsolved
    std::uint64_t contradicted = 0;  // groups whose frames cannot belong together
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] std::size_t memoryBytes() const;

 private:
  struct Frame {
    bool held = false, is_map = false;
    std::uint16_t sequence = 0;
    std::uint8_t size = 0;
    std::array<std::uint8_t, kMaxFrameBytes - kFrameOverhead> payload{};
  };
  struct Row {
    std::uint8_t row = 0;
    std::array<std::uint8_t, kMaxSymbolBytes> symbol{};
  };
  struct Group {
    bool used = false, done = false;
    std::uint16_t first = 0;
    int k = 0, rows = 0;
    std::size_t symbol_bytes = 0;
    std::optional<std::uint8_t> digest;
    std::uint64_t touched = 0;
    std::bitset<kMaxRepairRows> seen;
    std::array<Row, kMaxGroup> row{};
  };
  [[nodiscard]] std::uint8_t digestWith(const Group& group, std::span<const int> missing,
                                        std::span<const std::uint8_t> solved) const;
  enum class Outcome { kNotYet, kSolved, kContradiction };

  [[nodiscard]] const Frame* find(std::uint16_t sequence) const;
  Group& groupFor(std::uint16_t first, int k, std::size_t symbol_bytes, std::optional<std::uint8_t> digest);
  Outcome solve(Group& group, const std::function<void(std::uint16_t, std::span<const std::uint8_t>)>& give);

  std::vector<Frame> frames_;  // by sequence % kWindow
  std::vector<Group> groups_;
  std::uint64_t clock_ = 0;
  Counters counters_;
};

}  // namespace fathom::telemetry
