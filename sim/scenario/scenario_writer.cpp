#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include "firmware_if/files/civil_time.hpp"
#include "firmware_if/files/toml_text.hpp"
#include "realtime/kernel/text.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
namespace {

// A TOML number to twelve digits, so that what went through a rotation or a change of unit stays readable.
std::string tidy(double value) {
  const std::string number = formatted("%.12g", value + 0.0);  // + 0: no negative zero
  return number.find_first_of(".e") == std::string::npos ? number + ".0" : number;
}

std::string range(const char* unit, double low, double high) {
  return std::string("[") + unit + "] " + tidy(low) + " to " + tidy(high);
}

// Writes each key as a line; with `defaults`, each line also tells the default.
class Writer final : public KeyVisitor {
 public:
  explicit Writer(const std::map<std::string, std::string>* defaults) : defaults_(defaults) {}

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
    line(key, tidy(value * 180.0 / std::numbers::pi), range("deg", low_deg, high_deg), meaning);
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
  Writer default_values(nullptr);
  visitScenario(default_values, defaults);
  Scenario copy = scenario;
  Writer writer(&default_values.values());
  visitScenario(writer, copy);
  return writer.output();
}

}  // namespace fathom::sim
