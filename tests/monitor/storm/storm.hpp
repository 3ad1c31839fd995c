#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace fathom::test {

// What a storm was and what came of it.
struct StormResult {
  std::string what;                // the storm in a line
  std::vector<std::string> wrong;  // sentences; empty: good
  std::size_t nodes = 0;           // of the vehicle's map at the end
  std::uint64_t frames = 0;        // that the vehicle sent
  double seconds = 0;              // of the dive, storm and calm
};

// One dive's link, drawn by the seed: frame size, rate, loss, bursts, doubled, late and damaged frames, half
// duplex with lag; ground that appears, grows, moves, is emptied and gives way; restarts of vehicle and ship,
// a ship that comes late, loses its file or finds it damaged, clocks that step. Then a calm: every block that
// waits goes out. Holds the ship's map against the vehicle's.
[[nodiscard]] StormResult storm(unsigned seed);

}  // namespace fathom::test
