#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "telemetry/monitor/monitor_model.hpp"

namespace fathom::monitor {

// Where the frames come from and what time it is there, for display.
struct FeedState {
  std::int64_t now_utc_ns = 0;  // the wall clock; of a recorded file, the time of the last packet given
  bool recorded = false;        // frames come from a file
  bool finished = false;        // and it has ended
};

// /api/state: JSON; absent values are null.
[[nodiscard]] std::string stateJson(const MonitorModel& model, const FeedState& feed);
// /api/track: JSON {"points":[[utc_s,north_m,east_m,depth_m],...]}.
[[nodiscard]] std::string trackJson(const MonitorModel& model);
// /api/tiles: tiles newer than `since`, in the binary form that README.md and the page's tiles.ts describe.
[[nodiscard]] std::string tilesBinary(const MonitorModel& model, std::uint64_t since);
// The track and the vehicle as GeoJSON (WGS84 degrees, height = minus depth); empty without the mission's
// origin.
[[nodiscard]] std::string trackGeoJson(const MonitorModel& model);

}  // namespace fathom::monitor
