#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "recon/compare/plane_frame.hpp"
#include "recon/geometry/geodesy.hpp"

namespace fathom::topside {

// What a run leaves in its folder of results, read again. All throw InputError for what is not there or not
// as a run wrote it.

[[nodiscard]] nlohmann::json readResultJson(const std::filesystem::path& path);
// From scene.json; none: nobody knows where the dive was.
[[nodiscard]] std::optional<Geodetic> originOf(const std::filesystem::path& results);
// The plane frame of the results: about their origin, or unknown.
[[nodiscard]] compare::PlaneFrame frameOf(const std::filesystem::path& results);
// That of `crs`, as "EPSG:32755"; unknown if it is empty: of a dive of which nobody knows where it was.
[[nodiscard]] compare::PlaneFrame frameNamed(const std::string& crs);

// "EPSG:32755": the zone of UTM on WGS84 in which a place is.
[[nodiscard]] std::string utmOf(const Geodetic& place);

}  // namespace fathom::topside
