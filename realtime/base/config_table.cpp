#include "realtime/base/config_table.hpp"

#include <toml++/toml.h>
#include <cmath>
#include <fstream>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "realtime/base/civil_time.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom {
namespace {

// Shared by all tables of one file: its name, its tree, and the nodes that were read.
struct Document {
  std::string name;
  toml::table root;
  std::set<const toml::node*> asked;
};

std::string plain(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

std::string range(double min, double max) {
  return plain(min) + " to " + plain(max);
}

}  // namespace

struct ConfigTable::Impl {
  std::shared_ptr<Document> document;
  const toml::table* table = nullptr;  // null: absent in the file, all defaults
  std::string prefix;                  // "map." for a sub-table's keys in error lines

  const toml::node* find(std::string_view key) const {
    const toml::node* node = table ? table->get(key) : nullptr;
    if (node) document->asked.insert(node);
    return node;
  }

  [[noreturn]] void fail(std::string_view key, const toml::node* node, const std::string& fix) const {
    std::string place = "key '" + prefix + std::string(key) + "'";
    if (node && node->source().begin.line > 0)
      place = "line " + std::to_string(node->source().begin.line) + ", " + place;
    throw InputError(document->name, place, fix);
  }

  const toml::node& require(std::string_view key) const {
    const toml::node* node = find(key);
    if (!node) fail(key, nullptr, "is missing; add it");
    return *node;
  }

  double asNumber(std::string_view key, const toml::node& node, double min, double max) const {
    if (!node.is_number()) fail(key, &node, "must be a number, " + range(min, max));
    const double value =
        node.is_integer() ? static_cast<double>(node.as_integer()->get()) : node.as_floating_point()->get();
    if (!(value >= min && value <= max))
      fail(key, &node, plain(value) + " is out of range; give " + range(min, max));
    return value;
  }

  std::int64_t asInteger(std::string_view key, const toml::node& node, std::int64_t min,
                         std::int64_t max) const {
    const std::string bounds = std::to_string(min) + " to " + std::to_string(max);
    if (!node.is_integer()) fail(key, &node, "must be a whole number, " + bounds);
    const std::int64_t value = node.as_integer()->get();
    if (value < min || value > max)
      fail(key, &node, std::to_string(value) + " is out of range; give " + bounds);
    return value;
  }

  std::string asText(std::string_view key, const toml::node& node) const {
    if (!node.is_string()) fail(key, &node, "must be text in quotes");
    return node.as_string()->get();
  }

  std::vector<double> asNumbers(std::string_view key, const toml::node& node, std::size_t count, double min,
                                double max) const {
    const toml::array* array = node.as_array();
    if (!array || (count > 0 && array->size() != count))
      fail(key, &node, "must be an array of " + (count > 0 ? std::to_string(count) + " " : "") + "numbers");
    std::vector<double> values;
    for (const toml::node& item : *array) values.push_back(asNumber(key, item, min, max));
    return values;
  }

  // First node at or below `node` that was not read; its full key in `found`.
  const toml::node* unasked(const toml::node& node, const std::string& key, std::string& found) const {
    if (!document->asked.contains(&node)) {
      found = key;
      return &node;
    }
    const toml::node* first = nullptr;
    const auto consider = [&](const toml::node& child, const std::string& child_key) {
      std::string child_found;
      const toml::node* candidate = unasked(child, child_key, child_found);
      if (!candidate) return;
      if (first && first->source().begin.line <= candidate->source().begin.line) return;
      first = candidate;
      found = child_found;
    };
    if (const toml::table* sub = node.as_table()) {
      for (auto&& [name, child] : *sub)
        consider(child, (key.empty() ? "" : key + ".") + std::string(name.str()));
    } else if (const toml::array* array = node.as_array()) {
      for (const toml::node& child : *array)
        if (child.is_table()) consider(child, key);
    }
    return first;
  }
};

ConfigTable::ConfigTable(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ConfigTable::ConfigTable(const ConfigTable& other) : impl_(std::make_unique<Impl>(*other.impl_)) {}
ConfigTable::ConfigTable(ConfigTable&&) noexcept = default;
ConfigTable& ConfigTable::operator=(ConfigTable&&) noexcept = default;
ConfigTable::~ConfigTable() = default;

ConfigTable ConfigTable::load(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path))
    throw InputError(path, "", "cannot be read; give a TOML file");
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return parse(text, path.string());
}

ConfigTable ConfigTable::parse(std::string_view text, const std::string& name) {
  auto impl = std::make_unique<Impl>();
  impl->document = std::make_shared<Document>();
  impl->document->name = name;
  try {
    impl->document->root = toml::parse(text);
  } catch (const toml::parse_error& e) {
    throw InputError(name, "line " + std::to_string(e.source().begin.line),
                     "is not TOML: " + std::string(e.description()));
  }
  impl->table = &impl->document->root;
  impl->document->asked.insert(impl->table);
  return ConfigTable(std::move(impl));
}

bool ConfigTable::has(std::string_view key) const {
  return impl_->table && impl_->table->contains(key);
}

double ConfigTable::number(std::string_view key, double fallback, double min, double max) const {
  const toml::node* node = impl_->find(key);
  return node ? impl_->asNumber(key, *node, min, max) : fallback;
}

std::int64_t ConfigTable::integer(std::string_view key, std::int64_t fallback, std::int64_t min,
                                  std::int64_t max) const {
  const toml::node* node = impl_->find(key);
  return node ? impl_->asInteger(key, *node, min, max) : fallback;
}

bool ConfigTable::boolean(std::string_view key, bool fallback) const {
  const toml::node* node = impl_->find(key);
  if (!node) return fallback;
  if (!node->is_boolean()) impl_->fail(key, node, "must be true or false");
  return node->as_boolean()->get();
}

std::string ConfigTable::text(std::string_view key, std::string_view fallback) const {
  const toml::node* node = impl_->find(key);
  return node ? impl_->asText(key, *node) : std::string(fallback);
}

std::string ConfigTable::choice(std::string_view key, std::string_view fallback,
                                const std::vector<std::string>& allowed) const {
  std::string value = text(key, fallback);
  std::string list;
  for (const std::string& word : allowed) {
    if (word == value) return value;
    list += (list.empty() ? "" : ", ") + word;
  }
  impl_->fail(key, impl_->find(key), "'" + value + "' is none of: " + list);
}

std::vector<double> ConfigTable::numbers(std::string_view key, const std::vector<double>& fallback,
                                         std::size_t count, double min, double max) const {
  const toml::node* node = impl_->find(key);
  return node ? impl_->asNumbers(key, *node, count, min, max) : fallback;
}

double ConfigTable::requiredNumber(std::string_view key, double min, double max) const {
  return impl_->asNumber(key, impl_->require(key), min, max);
}

std::int64_t ConfigTable::requiredInteger(std::string_view key, std::int64_t min, std::int64_t max) const {
  return impl_->asInteger(key, impl_->require(key), min, max);
}

std::string ConfigTable::requiredText(std::string_view key) const {
  return impl_->asText(key, impl_->require(key));
}

std::vector<double> ConfigTable::requiredNumbers(std::string_view key, std::size_t count, double min,
                                                 double max) const {
  return impl_->asNumbers(key, impl_->require(key), count, min, max);
}

std::int64_t ConfigTable::requiredUtc(std::string_view key) const {
  static const char* const kForm = "must be a date and time in UTC, as 2026-03-01T02:03:04.5Z";
  const toml::node& node = impl_->require(key);
  const auto* value = node.as_date_time();
  if (!value || !value->get().offset || value->get().offset->minutes != 0) impl_->fail(key, &node, kForm);
  const auto& [date, time, offset] = value->get();
  const auto utc_ns = io::utcFromCivil({date.year, date.month, date.day, time.hour, time.minute, time.second,
                                        static_cast<int>(time.nanosecond)});
  if (!utc_ns) impl_->fail(key, &node, "does not exist or is outside the years 1678 to 2261");
  return *utc_ns;
}

ConfigTable ConfigTable::table(std::string_view key) const {
  auto sub = std::make_unique<Impl>();
  sub->document = impl_->document;
  sub->prefix = impl_->prefix + std::string(key) + ".";
  if (const toml::node* node = impl_->find(key)) {
    sub->table = node->as_table();
    if (!sub->table) impl_->fail(key, node, "must be a table: [" + impl_->prefix + std::string(key) + "]");
  }
  return ConfigTable(std::move(sub));
}

std::vector<ConfigTable> ConfigTable::tables(std::string_view key) const {
  std::vector<ConfigTable> result;
  const toml::node* node = impl_->find(key);
  if (!node) return result;
  const toml::array* array = node->as_array();
  if (!array)
    impl_->fail(key, node, "must be an array of tables: [[" + impl_->prefix + std::string(key) + "]]");
  for (const toml::node& item : *array) {
    auto sub = std::make_unique<Impl>();
    sub->document = impl_->document;
    sub->prefix = impl_->prefix + std::string(key) + ".";
    sub->table = item.as_table();
    if (!sub->table) impl_->fail(key, &item, "must be an array of tables");
    impl_->document->asked.insert(&item);
    result.push_back(ConfigTable(std::move(sub)));
  }
  return result;
}

void ConfigTable::finish() const {
  if (!impl_->table) return;
  std::string key;
  if (const toml::node* node = impl_->unasked(*impl_->table, "", key)) {
    throw InputError(
        impl_->document->name,
        "line " + std::to_string(node->source().begin.line) + ", key '" + impl_->prefix + key + "'",
        "is unknown; remove it or correct its spelling");
  }
}

void ConfigTable::fail(std::string_view key, const std::string& fix) const {
  impl_->fail(key, impl_->table ? impl_->table->get(key) : nullptr, fix);
}

}  // namespace fathom
