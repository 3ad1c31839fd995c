#include "realtime/base/config_keys.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom {
namespace {

// A TOML number with twelve digits, which hides the rounding of rotations and of changes of unit.
std::string rounded(double value) {
  const std::string number = formatted("%.12g", value + 0.0);  // + 0: no negative zero
  return number.find_first_of(".e") == std::string::npos ? number + ".0" : number;
}

std::string between(double low, double high) {
  return rounded(low) + " to " + rounded(high);
}

std::string joined(std::span<const std::string> parts, const char* separator) {
  std::string all;
  for (const std::string& part : parts) all += (all.empty() ? "" : separator) + part;
  return all;
}

}  // namespace

void KeyVisitor::require(bool, const char*, const std::string&) const {}

void KeyVisitor::optionalNumber(const char* key, std::optional<double>& value, const char* unit, double high,
                                const char* meaning) {
  double given = value.value_or(0);
  number(key, given, unit, 0, high, meaning);
  value = given > 0 ? std::optional(given) : std::nullopt;
}

void KeyVisitor::scaledNumber(const char* key, std::int64_t& value, std::int64_t step, const char* unit,
                              double low, double high, const char* meaning) {
  double given = static_cast<double>(value) / static_cast<double>(step);
  number(key, given, unit, low, high, meaning);
  value = std::llround(given * static_cast<double>(step));
}

void KeyVisitor::choiceText(const char* key, std::string& value, std::span<const char* const> names,
                            const char* meaning) {
  auto index = static_cast<std::size_t>(std::find(names.begin(), names.end(), value) - names.begin());
  choice(key, index, names, meaning);
  value = names[index];
}

std::size_t ConfigReader::beginList(const char* key, std::size_t count, const char*) {
  lists_.emplace_back();
  if (!top().has(key)) return count;
  return lists_.back().emplace(top().tables(key)).size();
}

void ConfigReader::enterItem(std::size_t index) {
  // Items that the file does not list keep their values: an empty table.
  tables_.push_back(lists_.back() ? std::move(lists_.back()->at(index)) : ConfigTable::parse("", ""));
}

void ConfigReader::angle(const char* key, double& value, const char*, double low_deg, double high_deg,
                         const char*) {
  if (top().has(key)) value = degreesToRadians(top().requiredNumber(key, low_deg, high_deg));
}

void ConfigReader::choice(const char* key, std::size_t& value, std::span<const char* const> names,
                          const char*) {
  const std::vector<std::string> allowed(names.begin(), names.end());
  const std::string given = top().choice(key, allowed[value], allowed);
  value = static_cast<std::size_t>(std::find(allowed.begin(), allowed.end(), given) - allowed.begin());
}

void ConfigReader::numbers(const char* key, std::span<double> values, const char*, double low, double high,
                           const char*) {
  const std::vector<double> given =
      top().numbers(key, {values.begin(), values.end()}, values.size(), low, high);
  std::copy(given.begin(), given.end(), values.begin());
}

void ConfigReader::integers(const char* key, std::vector<int>& values, int low, int high, const char*) {
  std::vector<int> whole;
  for (const double value : top().numbers(key, {values.begin(), values.end()}, 0, low, high)) {
    if (value != std::floor(value)) top().fail(key, "must be an array of whole numbers");
    whole.push_back(static_cast<int>(value));
  }
  values = whole;
}

void ConfigReader::require(bool good, const char* key, const std::string& fix) const {
  if (!good) top().fail(key, fix);
}

std::string ConfigListing::name() const {
  return joined(path_, ".");
}

void ConfigListing::line(const char* key, const std::string& value, const std::string& unit,
                         const std::string& range, const char* meaning) {
  const std::string full = path_.empty() ? key : name() + "." + key;
  rows_.push_back({full, value, unit, range, meaning});
  values_[full] = value;
  toml_ += std::string(key) + " = " + value + "  #";
  if (!unit.empty()) toml_ += " [" + unit + "]";
  if (!range.empty()) toml_ += " " + range;
  if (defaults_ != nullptr && defaults_->values_.contains(full))
    toml_ += ", default " + defaults_->values_.at(full);
  if (*meaning != '\0') toml_ += std::string(": ") + meaning;
  toml_ += "\n";
}

void ConfigListing::enter(const char* table, const char* meaning) {
  path_.emplace_back(table);
  toml_ += "\n[" + name() + "]" + (*meaning != '\0' ? std::string("  # ") + meaning : "") + "\n";
}

std::size_t ConfigListing::beginList(const char* key, std::size_t count, const char* meaning) {
  path_.emplace_back(key);
  if (count == 0) toml_ += "# no [[" + name() + "]]: " + meaning + "\n";
  return count;
}

void ConfigListing::enterItem(std::size_t index) {
  toml_ += "\n[[" + name() + "]]\n";
  path_.back() += "#" + std::to_string(index);
}

void ConfigListing::number(const char* key, double& value, const char* unit, double low, double high,
                           const char* meaning) {
  line(key, rounded(value), unit, between(low, high), meaning);
}

void ConfigListing::angle(const char* key, double& value, const char* unit, double low_deg, double high_deg,
                          const char* meaning) {
  line(key, rounded(radiansToDegrees(value)), unit, between(low_deg, high_deg), meaning);
}

void ConfigListing::integer(const char* key, std::int64_t& value, const char* unit, std::int64_t low,
                            std::int64_t high, const char* meaning) {
  line(key, std::to_string(value), unit, std::to_string(low) + " to " + std::to_string(high), meaning);
}

void ConfigListing::boolean(const char* key, bool& value, const char* meaning) {
  line(key, value ? "true" : "false", "", "true or false", meaning);
}

void ConfigListing::utc(const char* key, std::int64_t& value, const char* meaning) {
  const io::CivilTime t = io::civilFromUtc(value);
  line(key,
       formatted("%04d-%02d-%02dT%02d:%02d:%02d.%09dZ", t.year, t.month, t.day, t.hour, t.minute, t.second,
                 t.nanosecond),
       "", "ISO 8601 in UTC", meaning);
}

void ConfigListing::text(const char* key, std::string& value, const char* meaning) {
  line(key, tomlString(value), "", "text", meaning);
}

void ConfigListing::choice(const char* key, std::size_t& value, std::span<const char* const> names,
                           const char* meaning) {
  const std::vector<std::string> all(names.begin(), names.end());
  line(key, tomlString(names[value]), "", joined(all, " or "), meaning);
}

void ConfigListing::numbers(const char* key, std::span<double> values, const char* unit, double low,
                            double high, const char* meaning) {
  std::vector<std::string> all;
  for (const double value : values) all.push_back(rounded(value));
  line(key, "[" + joined(all, ", ") + "]", unit, between(low, high), meaning);
}

void ConfigListing::integers(const char* key, std::vector<int>& values, int low, int high,
                             const char* meaning) {
  std::vector<std::string> all;
  for (const int value : values) all.push_back(std::to_string(value));
  line(key, "[" + joined(all, ", ") + "]", "",
       "array of " + std::to_string(low) + " to " + std::to_string(high), meaning);
}

std::string tomlNumber(double value) {
  std::array<char, 40> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  std::string text(buffer.data(), end);
  // In TOML a number without point and exponent is an integer.
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string tomlString(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      quoted += '\\';
      quoted += c;
    } else if (c == '\n') {
      quoted += "\\n";
    } else if (c == '\t') {
      quoted += "\\t";
    } else if (byte < 0x20 || byte == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04X", byte);
      quoted += escape;
    } else {
      quoted += c;
    }
  }
  return quoted + "\"";
}

}  // namespace fathom
