#include "sim/scenario/scenario_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/civil_time.hpp"
#include "realtime/base/config_table.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::sim {
namespace {

// Replaces defaults by the values of a TOML file.
class ScenarioReader final : public KeyVisitor {
 public:
  explicit ScenarioReader(ConfigTable top) { tables_.push_back(std::move(top)); }
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
    if (top().has(key)) value = degreesToRadians(top().requiredNumber(key, low_deg, high_deg));
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
  ScenarioReader reader(std::move(top));
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

namespace {

// A TOML number with twelve digits, which hides the rounding of rotations and of changes of unit.
std::string tidy(double value) {
  const std::string number = formatted("%.12g", value + 0.0);  // + 0: no negative zero
  return number.find_first_of(".e") == std::string::npos ? number + ".0" : number;
}

std::string range(const char* unit, double low, double high) {
  return std::string("[") + unit + "] " + tidy(low) + " to " + tidy(high);
}

// Writes each key as a line; with `defaults`, each line also states the default.
class ScenarioWriter final : public KeyVisitor {
 public:
  explicit ScenarioWriter(const std::map<std::string, std::string>* defaults) : defaults_(defaults) {}

  [[nodiscard]] const std::string& output() const { return output_; }
  [[nodiscard]] const std::map<std::string, std::string>& values() const { return values_; }

  void enter(const char* table, const char* meaning) override {
    path_.push_back(table);
    output_ += "\n[" + name() + "]" + (*meaning != '\0' ? std::string("  # ") + meaning : "") + "\n";
  }
  void leave() override { path_.pop_back(); }
  std::size_t beginList(const char* key, std::size_t count, const char* meaning) override {
    path_.push_back(key);
    if (count == 0) output_ += "# no [[" + name() + "]]: " + meaning + "\n";
    return count;
  }
  void enterItem(std::size_t index) override {
    output_ += "\n[[" + name() + "]]\n";
    path_.back() += "#" + std::to_string(index);
  }
  void leaveItem() override { path_.back().resize(path_.back().find('#')); }
  void endList() override { path_.pop_back(); }

  void number(const char* key, double& value, const char* unit, double low, double high,
              const char* meaning) override {
    line(key, tidy(value), range(unit, low, high), meaning);
  }
  void angle(const char* key, double& value, double low_deg, double high_deg, const char* meaning) override {
    line(key, tidy(radiansToDegrees(value)), range("deg", low_deg, high_deg), meaning);
  }
  void integer(const char* key, std::int64_t& value, std::int64_t low, std::int64_t high,
               const char* meaning) override {
    line(key, std::to_string(value), std::to_string(low) + " to " + std::to_string(high), meaning);
  }
  void utc(const char* key, std::int64_t& value, const char* meaning) override {
    const io::CivilTime t = io::civilFromUtc(value);
    line(key,
         formatted("%04d-%02d-%02dT%02d:%02d:%02d.%09dZ", t.year, t.month, t.day, t.hour, t.minute, t.second,
                   t.nanosecond),
         "ISO 8601 in UTC", meaning);
  }
  void text(const char* key, std::string& value, const char* meaning) override {
    line(key, io::tomlString(value), "text", meaning);
  }
  void choice(const char* key, std::size_t& value, std::span<const char* const> names,
              const char* meaning) override {
    std::string list;
    for (const char* n : names) list += (list.empty() ? "" : " or ") + std::string(n);
    line(key, io::tomlString(names[value]), list, meaning);
  }
  void vector3(const char* key, Eigen::Vector3d& value, const char* unit, double low, double high,
               const char* meaning) override {
    line(key, "[" + tidy(value.x()) + ", " + tidy(value.y()) + ", " + tidy(value.z()) + "]",
         range(unit, low, high), meaning);
  }

 private:
  [[nodiscard]] std::string name() const {
    std::string joined;
    for (const std::string& part : path_) joined += (joined.empty() ? "" : ".") + part;
    return joined;
  }
  void line(const char* key, const std::string& value, const std::string& allowed, const char* meaning) {
    const std::string full = name() + "." + key;
    values_[full] = value;
    output_ += std::string(key) + " = " + value + "  # " + allowed;
    if (defaults_ != nullptr && defaults_->contains(full)) output_ += ", default " + defaults_->at(full);
    if (*meaning != '\0') output_ += std::string(": ") + meaning;
    output_ += "\n";
  }

  const std::map<std::string, std::string>* defaults_;
  std::vector<std::string> path_;
  std::string output_;
  std::map<std::string, std::string> values_;
};

}  // namespace

std::string scenarioToml(const Scenario& scenario) {
  Scenario defaults;
  ScenarioWriter default_values(nullptr);
  visitScenario(default_values, defaults);
  Scenario copy = scenario;
  ScenarioWriter writer(&default_values.values());
  visitScenario(writer, copy);
  return writer.output();
}

}  // namespace fathom::sim
