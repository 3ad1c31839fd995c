#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "telemetry/repair/repair_symbol.hpp"

namespace fathom::telemetry {

// Recovers lost map packets from repair frames (repair_symbol.hpp). Keeps the last kWindow frames and the
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
