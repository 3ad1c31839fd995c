#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "telemetry/monitor/model/shared_model.hpp"
#include "telemetry/wire/downlink_messages.hpp"

namespace fathom::monitor {

inline constexpr std::size_t kMaxBodyBytes = 512;  // of anything that the page posts

// What a page posts, read with every bound checked. On refusal `why` says in one line what is wrong.
//   /api/request: {"kind":"detail","north_m":[0,10],"east_m":[0,10],"spacing_m":0.125,"max_error_m":0.05},
//     {"kind":"rate","rate_bps":300}, {"kind":"pause-map"}, {"kind":"resume-map"}, {"kind":"send-status"}
//   /api/fix, for the ship's USBL program: {"utc_s":1.79e9,"latitude_deg":-27.5,"longitude_deg":153.5,
//     "depth_m":20,"sigma_m":1.5}, the last two optional
//   /api/playback: any of {"seek_utc_s":1.79e9,"speed":10,"playing":true}
[[nodiscard]] std::optional<telemetry::Request> parseRequest(std::string_view body, std::string& why);
[[nodiscard]] std::optional<telemetry::UsblFixMessage> parseFix(std::string_view body, std::string& why);
[[nodiscard]] std::optional<PlaybackWish> parsePlayback(std::string_view body, std::string& why);

}  // namespace fathom::monitor
