#include "sim/scenario/scenario_file.hpp"

#include <algorithm>
#include <cstdlib>
#include <stdexcept>
#include <utility>
#include <vector>

#include "realtime/kernel/config_table.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/install_prefix.hpp"

namespace fathom::sim {
namespace {

// Replaces the defaults by what the file says.
class Reader final : public KeyVisitor {
 public:
  explicit Reader(ConfigTable top) { tables_.push_back(std::move(top)); }
  void finish() const { tables_.front().finish(); }

  void enter(const char* table, const char*) override { tables_.push_back(top().table(table)); }
  void leave() override { tables_.pop_back(); }
  std::size_t beginList(const char* key, std::size_t count, const char*) override {
    lists_.emplace_back();
    if (!top().has(key)) {
      given_.push_back(false);
      return count;
    }
    given_.push_back(true);
    lists_.back() = top().tables(key);
    return lists_.back().size();
  }
  void enterItem(std::size_t index) override {
    // Items that the file does not list keep their defaults: an empty table.
    if (given_.back()) {
      tables_.push_back(std::move(lists_.back().at(index)));
    } else {
      tables_.push_back(ConfigTable::parse("", ""));
    }
  }
  void leaveItem() override { tables_.pop_back(); }
  void endList() override {
    lists_.pop_back();
    given_.pop_back();
  }

  void number(const char* key, double& value, const char*, double low, double high, const char*) override {
    value = top().number(key, value, low, high);
  }
  void angle(const char* key, double& value, double low_deg, double high_deg, const char*) override {
    if (top().has(key)) value = degrees(top().requiredNumber(key, low_deg, high_deg));
  }
  void integer(const char* key, std::int64_t& value, std::int64_t low, std::int64_t high,
               const char*) override {
    value = top().integer(key, value, low, high);
  }
  void utc(const char* key, std::int64_t& value, const char*) override {
    if (top().has(key)) value = top().requiredUtc(key);
  }
  void text(const char* key, std::string& value, const char*) override { value = top().text(key, value); }
  void choice(const char* key, std::size_t& value, std::span<const char* const> names, const char*) override {
    const std::vector<std::string> allowed(names.begin(), names.end());
    const std::string given = top().choice(key, allowed[value], allowed);
    value = static_cast<std::size_t>(std::find(allowed.begin(), allowed.end(), given) - allowed.begin());
  }
  void vector3(const char* key, Eigen::Vector3d& value, const char*, double low, double high,
               const char*) override {
    const std::vector<double> v = top().numbers(key, {value.x(), value.y(), value.z()}, 3, low, high);
    value = {v[0], v[1], v[2]};
  }

 private:
  [[nodiscard]] const ConfigTable& top() const { return tables_.back(); }

  std::vector<ConfigTable> tables_;
  std::vector<std::vector<ConfigTable>> lists_;
  std::vector<bool> given_;
};

}  // namespace

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
  Reader reader(std::move(top));
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

}  // namespace fathom::sim
