#include "sim/scenario/scenario_file.hpp"

#include <cstdlib>
#include <stdexcept>
#include <string>

#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"

namespace fathom::sim {
std::filesystem::path shippedScenarios() {
  return installPrefix() / "share/fathom/scenarios";
}

std::filesystem::path dataFolder() {
  const char* folder = std::getenv("FATHOM_DATA_DIR");
  return folder != nullptr && *folder != '\0' ? folder : installPrefix() / "share/fathom/data";
}

TerrainConfig resolvedTerrain(const Scenario& scenario) {
  TerrainConfig terrain = scenario.terrain;
  const auto resolve = [&scenario](std::filesystem::path& path, const char* key) {
    if (path.empty() || path.is_absolute()) return;
    const std::filesystem::path beside = scenario.file.parent_path() / path;
    const std::filesystem::path captured = dataFolder() / path;
    for (const std::filesystem::path& candidate : {beside, captured}) {
      if (!std::filesystem::exists(candidate)) continue;
      path = candidate;
      return;
    }
    throw InputError(scenario.file.string(), std::string("key terrain.") + key,
                     path.string() + " is neither beside the scenario nor in " + dataFolder().string() +
                         "; set FATHOM_DATA_DIR to the folder of real captures");
  };
  resolve(terrain.mesh_file, "mesh_file");
  resolve(terrain.relief_file, "relief_file");
  resolve(terrain.texture_file, "texture_file");
  resolve(terrain.albedo_images, "albedo_images");
  return terrain;
}

Scenario loadScenario(const std::string& name_or_path) {
  const std::filesystem::path shipped = shippedScenarios() / (name_or_path + ".toml");
  const bool is_name = name_or_path.find('/') == std::string::npos && !std::filesystem::exists(name_or_path);
  if (is_name && !std::filesystem::exists(shipped)) {
    throw InputError(name_or_path, "", "is neither a file nor a scenario in " + shippedScenarios().string());
  }
  Scenario scenario;
  scenario.file = is_name ? shipped : std::filesystem::path(name_or_path);
  ConfigTable top = ConfigTable::load(scenario.file);
  static_cast<void>(top.requiredText("name"));
  ConfigReader reader(std::move(top));
  visitScenario(reader, scenario);
  reader.finish();

  const std::string file = scenario.file.string();
  const auto check = [&file](const char* table, const auto& config) {
    try {
      validate(config);
    } catch (const std::invalid_argument& e) {
      throw InputError(file, std::string("table ") + table, e.what());
    }
  };
  check("terrain", scenario.terrain);
  check("optics", scenario.optics);
  if (scenario.vehicle.min_altitude_m >= scenario.vehicle.follower.altitude_m)
    throw InputError(file, "key vehicle.min_altitude_m", "must be below vehicle.altitude_m");
  if (scenario.vehicle.shortest_roll_period_s >= scenario.vehicle.longest_roll_period_s)
    throw InputError(file, "key vehicle.shortest_roll_period_s", "must be below longest_roll_period_s");
  if (scenario.terrain.kind == TerrainKind::kMesh && scenario.terrain.mesh_file.empty())
    throw InputError(file, "key terrain.mesh_file", "is empty; name the PLY file of the mesh");
  static_cast<void>(resolvedTerrain(scenario));
  return scenario;
}

std::string scenarioToml(const Scenario& scenario) {
  return configToml(scenario, Scenario(), visitScenario);
}

}  // namespace fathom::sim
