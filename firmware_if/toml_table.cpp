#include "firmware_if/toml_table.hpp"

#include <toml++/toml.h>

#include <array>
#include <charconv>
#include <cstdio>
#include <utility>

#include "firmware_if/civil_time.hpp"
#include "firmware_if/file_bytes.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kMaxTomlBytes = std::size_t{1} << 22;

std::string typeName(const toml::node& node) {
  std::string name;
  switch (node.type()) {
    case toml::node_type::table:
      name = "a table";
      break;
    case toml::node_type::array:
      name = "an array";
      break;
    case toml::node_type::string:
      name = "a string";
      break;
    case toml::node_type::integer:
      name = "an integer";
      break;
    case toml::node_type::floating_point:
      name = "a number";
      break;
    case toml::node_type::boolean:
      name = "true or false";
      break;
    default:
      name = "a date or time";
  }
  return name;
}

std::optional<double> asNumber(const toml::node& node) {
  if (const auto* floating = node.as_floating_point()) return floating->get();
  if (const auto* integer = node.as_integer()) return static_cast<double>(integer->get());
  return std::nullopt;
}

}  // namespace

struct TomlTable::File {
  std::filesystem::path path;
  toml::table root;
};

struct TomlTable::State {
  const toml::table* node = nullptr;  // null: an absent table taken as empty
  std::string prefix;                 // "cameras."
  std::set<std::string> asked;
  std::vector<std::shared_ptr<State>> children;

  const toml::node* find(const char* key) {
    asked.insert(key);
    return node == nullptr ? nullptr : node->get(key);
  }
};

TomlTable TomlTable::read(const std::filesystem::path& path, const char* what) {
  const std::vector<std::uint8_t> bytes = readFileBytes(path, kMaxTomlBytes, what);
  return parse(path, std::string(bytes.begin(), bytes.end()));
}

TomlTable TomlTable::parse(const std::filesystem::path& path, const std::string& text) {
  auto file = std::make_shared<File>();
  file->path = path;
  try {
    file->root = toml::parse(text);
  } catch (const toml::parse_error& e) {
    throw InputError(path, "line " + std::to_string(e.source().begin.line),
                     "is no TOML: " + std::string(e.description()));
  }
  auto state = std::make_shared<State>();
  state->node = &file->root;
  return {std::move(file), std::move(state)};
}

void TomlTable::fail(const std::string& key, const std::string& mend) const {
  const toml::node* node = state_->node == nullptr ? nullptr : state_->node->get(key);
  if (node == nullptr) node = state_->node;
  std::string place = "key " + state_->prefix + key;
  if (node != nullptr && node->source().begin.line != 0)
    place += " (line " + std::to_string(node->source().begin.line) + ")";
  throw InputError(file_->path, place, mend);
}

double TomlTable::number(const char* key, double min, double max, std::optional<double> absent) const {
  const toml::node* node = state_->find(key);
  if (node == nullptr && absent) return *absent;
  const std::string range = "give a number from " + tomlNumber(min) + " to " + tomlNumber(max);
  if (node == nullptr) fail(key, "is missing; " + range);
  const std::optional<double> value = asNumber(*node);
  if (!value) fail(key, "is " + typeName(*node) + "; " + range);
  if (!(*value >= min && *value <= max)) fail(key, tomlNumber(*value) + " is out of range; " + range);
  return *value;
}

std::int64_t TomlTable::integer(const char* key, std::int64_t min, std::int64_t max,
                                std::optional<std::int64_t> absent) const {
  const toml::node* node = state_->find(key);
  if (node == nullptr && absent) return *absent;
  const std::string range = "give a whole number from " + std::to_string(min) + " to " + std::to_string(max);
  if (node == nullptr) fail(key, "is missing; " + range);
  const auto* value = node->as_integer();
  if (value == nullptr) fail(key, "is " + typeName(*node) + "; " + range);
  if (value->get() < min || value->get() > max)
    fail(key, std::to_string(value->get()) + " is out of range; " + range);
  return value->get();
}

bool TomlTable::flag(const char* key, std::optional<bool> absent) const {
  const toml::node* node = state_->find(key);
  if (node == nullptr && absent) return *absent;
  if (node == nullptr) fail(key, "is missing; give true or false");
  const auto* value = node->as_boolean();
  if (value == nullptr) fail(key, "is " + typeName(*node) + "; give true or false");
  return value->get();
}

std::string TomlTable::text(const char* key, const std::optional<std::string>& absent) const {
  const toml::node* node = state_->find(key);
  if (node == nullptr && absent) return *absent;
  if (node == nullptr) fail(key, "is missing; give a string");
  const auto* value = node->as_string();
  if (value == nullptr) fail(key, "is " + typeName(*node) + "; give a string");
  return value->get();
}

std::size_t TomlTable::choice(const char* key, std::initializer_list<const char*> names) const {
  std::string list;
  for (const char* name : names) list += (list.empty() ? "" : ", ") + tomlString(name);
  if (!has(key)) fail(key, "is missing; give one of " + list);
  const std::string value = text(key);
  std::size_t index = 0;
  for (const char* name : names) {
    if (value == name) return index;
    ++index;
  }
  fail(key, tomlString(value) + " is unknown; give one of " + list);
}

Eigen::Vector3d TomlTable::vector3(const char* key, double min, double max) const {
  const toml::node* node = state_->find(key);
  const std::string form = "give [x, y, z], each from " + tomlNumber(min) + " to " + tomlNumber(max);
  if (node == nullptr) fail(key, "is missing; " + form);
  const toml::array* array = node->as_array();
  if (array == nullptr || array->size() != 3)
    fail(key, "is " + (array == nullptr ? typeName(*node) : std::to_string(array->size()) + " values") +
                  "; " + form);
  Eigen::Vector3d vector;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::optional<double> value = asNumber(*array->get(i));
    if (!value || !(*value >= min && *value <= max))
      fail(key, "element " + std::to_string(i + 1) + " is no number or out of range; " + form);
    vector(static_cast<Eigen::Index>(i)) = *value;
  }
  return vector;
}

std::int64_t TomlTable::utc(const char* key) const {
  const toml::node* node = state_->find(key);
  static const char* const kForm = "give a date and time in UTC, as 2026-03-01T02:03:04.5Z";
  if (node == nullptr) fail(key, std::string("is missing; ") + kForm);
  const auto* value = node->as_date_time();
  if (value == nullptr) fail(key, "is " + typeName(*node) + "; " + kForm);
  const toml::date_time& moment = value->get();
  if (!moment.offset || moment.offset->minutes != 0) fail(key, std::string("is not in UTC; ") + kForm);
  const auto utc_ns =
      utcFromCivil({moment.date.year, moment.date.month, moment.date.day, moment.time.hour,
                    moment.time.minute, moment.time.second, static_cast<int>(moment.time.nanosecond)});
  if (!utc_ns) fail(key, std::string("does not exist or is out of range (years 1678 to 2261); ") + kForm);
  return *utc_ns;
}

TomlTable TomlTable::tableOr(const char* key) const {
  const toml::node* node = state_->find(key);
  auto child = std::make_shared<State>();
  child->prefix = state_->prefix + key + ".";
  if (node != nullptr) {
    child->node = node->as_table();
    if (child->node == nullptr)
      fail(key, "is " + typeName(*node) + "; give a table [" + state_->prefix + key + "]");
  }
  state_->children.push_back(child);
  return {file_, child};
}

TomlTable TomlTable::table(const char* key) const {
  if (!has(key)) fail(key, "is missing; give a table [" + state_->prefix + key + "]");
  return tableOr(key);
}

std::vector<TomlTable> TomlTable::tables(const char* key) const {
  std::vector<TomlTable> result;
  const toml::node* node = state_->find(key);
  if (node == nullptr) return result;
  const toml::array* array = node->as_array();
  if (array == nullptr) fail(key, "is " + typeName(*node) + "; give tables [[" + state_->prefix + key + "]]");
  for (std::size_t i = 0; i < array->size(); ++i) {
    auto child = std::make_shared<State>();
    child->prefix = state_->prefix + key + "[" + std::to_string(i) + "].";
    child->node = array->get(i)->as_table();
    if (child->node == nullptr) fail(key, "holds a value; give tables [[" + state_->prefix + key + "]]");
    state_->children.push_back(child);
    result.push_back({file_, child});
  }
  return result;
}

bool TomlTable::has(const char* key) const {
  return state_->node != nullptr && state_->node->contains(key);
}

void TomlTable::finish() const {
  if (state_->node != nullptr) {
    for (const auto& [key, value] : *state_->node) {
      const std::string name(key.str());
      if (state_->asked.count(name) == 0) {
        std::string known;
        for (const std::string& asked : state_->asked) known += (known.empty() ? "" : ", ") + asked;
        fail(name, "is unknown; correct or remove it (known here: " + known + ")");
      }
    }
  }
  for (const auto& child : state_->children) TomlTable(file_, child).finish();
}

std::string tomlNumber(double value) {
  std::array<char, 40> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  std::string text(buffer.data(), end);
  // TOML tells numbers from integers by the point or the exponent.
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

}  // namespace fathom::io
