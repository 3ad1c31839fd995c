#pragma once

#include <cstdint>
#include <vector>

#include "telemetry/vehicle/link_scheduler.hpp"
#include "tests/bench/link/seafloor_lattice.hpp"

namespace fathom::bench {

// A vehicle that mows a seafloor, the real link in both directions over a simulated channel, and the ship.
struct SurveyConfig {
  double rate_bps = 80;
  int frame_bytes = 32;
  double loss = 0.3;      // either way
  double mean_burst = 0;  // 0: each frame by itself
  double delay_s = 0.5;   // one way
  int colour_bits = 0;
  double speed_mps = 2.0 / 3, swath_m = 1.5, line_m = 30;  // 1 m2/s
  double survey_s = 1200;
  double after_s = 0;                    // and goes on sending for so long at most
  double ship_off_s = 0, ship_on_s = 0;  // the ship is switched off in between
  bool pause_mapping = false;            // nothing new is imaged from ship_on_s on
  std::uint64_t seed = 1;
  telemetry::LinkSchedulerConfig scheduler;  // rate, frame and colours are set from above
};

struct SurveyResult {
  double imaged_m2 = 0;      // in all
  double judged_m2 = 0;      // imaged long enough before the end to be judged
  double in_time_share = 0;  // of the judged area: shown within 60 s at the spacing and error asked for
  double coarse_in_time_share = 0;  // shown within 60 s at any spacing
  double shown_share = 0;           // of the imaged area, at the end
  double p50_s = 0, p95_s = 0;      // latency of what was shown; the rest counts as for ever
  double max_error_m = 0;           // of what is shown at the end
  double bytes_per_m2 = 0;          // of all frames sent, of the area shown
  double map_bytes_per_m2 = 0;      // of map frames alone, once each block: bytes sent over area sent
  double bytes_per_map_frame = 0, blocks_per_map_frame = 0;
  double listening_share = 0;    // of the time
  double complete_after_s = -1;  // from ship_on_s until everything imaged by then is shown; -1: never
  double uplink_loss = 0;
  telemetry::LinkScheduler::Counters counters;
  std::uint64_t downlink_frames = 0;
};

[[nodiscard]] SurveyResult runSurvey(const SeafloorLattice& seafloor, const SurveyConfig& config);

}  // namespace fathom::bench
