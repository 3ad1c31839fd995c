#pragma once

#include <cstdint>

namespace fathom::bench {

// A set of tiles through the real scheduler and receiver over a channel that only loses frames, seed by seed.
struct ReliabilityConfig {
  double loss = 0.3;
  double mean_burst = 0;  // 0: each frame by itself
  bool feedback = true;   // acknowledgements every 32 frames, or when the sender has nothing else to send
  int seeds = 200;
};

struct ReliabilityResult {
  int packets = 0;            // K: frames without loss
  double bound = 0;           // K / (1 - p)
  double mean_frames = 0;     // map and repair frames sent until 99 % of the blocks are with the receiver
  double standard_error = 0;  // of the mean
  double p95_frames = 0;
  double finished_share = 0;  // runs that got to 99 %; the others count with all that they sent
  double mean_complete = 0;   // share of blocks when the sender stopped
};

[[nodiscard]] ReliabilityResult measureReliability(const ReliabilityConfig& config);

}  // namespace fathom::bench
