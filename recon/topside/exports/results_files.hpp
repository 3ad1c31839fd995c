#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "recon/geometry/geodesy.hpp"

namespace fathom::topside {

// What a run leaves in its folder of results, read again. All throw InputError for what is not there or not
// as a run wrote it.

[[nodiscard]] nlohmann::json readResultJson(const std::filesystem::path& path);
// From scene.json.
[[nodiscard]] Geodetic originOf(const std::filesystem::path& results);

// "EPSG:32755": the zone of UTM on WGS84 in which a place lies.
[[nodiscard]] std::string utmOf(const Geodetic& place);

}  // namespace fathom::topside
