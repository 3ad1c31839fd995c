#pragma once

#include <cstdint>
#include <string>

#include "telemetry/monitor/model/model_view.hpp"

namespace fathom::monitor {

// /api/state: JSON; absent values are null. page/src/api.ts has the same fields. Refreshes the view, and
// holds the model's lock for what is not of the map.
[[nodiscard]] std::string stateJson(SharedModel& shared, ModelView& view);
// /api/track: JSON {"points":[[utc_s,north_m,east_m,depth_m],...]}.
[[nodiscard]] std::string trackJson(const ModelView& view);
// /api/history: JSON {"start_utc_s":..,"step_s":..,"steps":[[bit/s, accepted, lost, rejected],...]}.
[[nodiscard]] std::string historyJson(const MonitorModel& model);
// /api/profile: the map along a line, JSON {"points":[[along_m,depth_m,sigma_m] or null,...]}; null: no map.
inline constexpr int kProfilePoints = 400;
[[nodiscard]] std::string profileJson(const Surface& surface, double north0, double east0, double north1,
                                      double east1);
// /api/coverage: pending squares, binary; page/src/chunks.ts describes it.
[[nodiscard]] std::string coverageBinary(const Coverage& coverage);
// What a page has to know to tell whether its map is of this model.
[[nodiscard]] std::string epochOf(const SharedModel& shared);
[[nodiscard]] std::string epochOf(const ModelView& view);

}  // namespace fathom::monitor
