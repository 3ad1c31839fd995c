#include "recon/products/exports/results_files.hpp"

#include <cmath>
#include <fstream>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::topside {
namespace {}  // namespace

nlohmann::json readResultJson(const std::filesystem::path& path) {
  std::ifstream stream(path);
  if (!stream) throw InputError(path.string(), "", "cannot be opened; name a run's mission or results");
  nlohmann::json json = nlohmann::json::parse(stream, nullptr, false);
  if (json.is_discarded()) throw InputError(path.string(), "", "is no JSON: make it again with a run");
  return json;
}

std::optional<Geodetic> originOf(const std::filesystem::path& results) {
  const nlohmann::json scene = readResultJson(results / "scene.json");
  try {
    const nlohmann::json& origin = scene.at("origin");
    if (origin.is_null()) return {};
    return Geodetic{origin.at("latitude").get<double>() * kRadiansPerDegree,
                    origin.at("longitude").get<double>() * kRadiansPerDegree};
  } catch (const nlohmann::json::exception&) {
    throw InputError((results / "scene.json").string(), "origin", "is not as a run writes it");
  }
}

compare::PlaneFrame frameOf(const std::filesystem::path& results) {
  const auto origin = originOf(results);
  return origin ? compare::localFrame(*origin) : compare::PlaneFrame();
}

compare::PlaneFrame frameNamed(const std::string& crs) {
  return crs.empty() ? compare::PlaneFrame() : compare::frameFrom(crs, "--crs");
}

std::string utmOf(const Geodetic& place) {
  constexpr int kNorth = 32600, kSouth = 32700;  // EPSG: WGS 84 / UTM zone n
  return "EPSG:" + std::to_string((place.latitude < 0 ? kSouth : kNorth) + utmZone(place.longitude));
}

}  // namespace fathom::topside
