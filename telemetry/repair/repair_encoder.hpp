#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "telemetry/repair/repair_symbol.hpp"

namespace fathom::telemetry {

// Repair frames for a group of k members so that all of it is known with probability 0.99 when each frame is
// lost with probability `loss`, in bursts of `burst` frames in the mean (1 / (1 - loss): independently).
// Normal approximation of what arrives; the variance of a Gilbert-Elliott channel is (1 + c) / (1 - c) times
// that of independent losses, c = 1 - 1 / burst - loss / (burst (1 - loss)).
[[nodiscard]] int repairRows(int k, double loss, double burst);

// Makes repair frames (repair_symbol.hpp) for frames that are not acknowledged. Frames form groups in the
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

}  // namespace fathom::telemetry
