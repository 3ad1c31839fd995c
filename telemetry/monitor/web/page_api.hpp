#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::monitor {

// /api/state: JSON; absent values are null. page/src/api.ts has the same fields. Refreshes the view, and
// holds the model's lock for all but the map.
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
// Identifies the model and map: a page with another value loads everything again.
[[nodiscard]] std::string epochOf(const SharedModel& shared);
[[nodiscard]] std::string epochOf(const ModelView& view);

inline constexpr std::size_t kMaxBodyBytes = 512;  // of anything that the page posts

// Parses what a page posts and checks every bound. On refusal `why` is one line with the reason.
//   /api/request: {"kind":"detail","north_m":[0,10],"east_m":[0,10],"spacing_m":0.125,"max_error_m":0.05},
//     {"kind":"rate","rate_bps":300}, {"kind":"pause-map"}, {"kind":"resume-map"}, {"kind":"send-status"}
//   /api/fix, for the ship's USBL program: {"utc_s":1.79e9,"latitude_deg":-27.5,"longitude_deg":153.5,
//     "depth_m":20,"sigma_m":1.5}, the last two optional
//   /api/playback: any of {"seek_utc_s":1.79e9,"speed":10,"playing":true}
[[nodiscard]] std::optional<telemetry::Request> parseRequest(std::string_view body, std::string& why);
[[nodiscard]] std::optional<telemetry::UsblFixMessage> parseFix(std::string_view body, std::string& why);
[[nodiscard]] std::optional<PlaybackRequest> parsePlayback(std::string_view body, std::string& why);

}  // namespace fathom::monitor
