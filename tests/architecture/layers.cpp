#include "tests/architecture/layers.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <functional>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string_view>

namespace fathom::test {
namespace {

constexpr std::array<std::string_view, 5> kFolders{"firmware_if", "realtime", "recon", "telemetry", "sim"};

std::string describe(const Place& place) {
  return (place.is_main ? "main of " : "") + place.module + ", layer " + std::to_string(place.layer);
}

bool isSource(const std::filesystem::path& path) {
  static const std::set<std::string> extensions{".h", ".hpp", ".c", ".cc", ".cpp", ".inl", ".in"};
  return extensions.count(path.extension().string()) != 0;
}

// Folders of fetched or generated files beside ours.
bool isForeign(const std::filesystem::path& folder) {
  return folder.filename() == "node_modules" || folder.filename() == "dist" ||
         folder.filename().string().starts_with(".");
}

// Calls `visit` with each file of the five folders and its name from the root.
void forEachFile(const std::filesystem::path& root,
                 const std::function<void(const std::filesystem::path&, const std::string&)>& visit) {
  for (const std::string_view folder : kFolders) {
    if (!std::filesystem::exists(root / folder)) continue;
    std::filesystem::recursive_directory_iterator entry(root / folder), end;
    for (; entry != end; ++entry) {
      if (entry->is_directory() && isForeign(entry->path())) entry.disable_recursion_pending();
      if (entry->is_regular_file())
        visit(entry->path(), entry->path().lexically_relative(root).generic_string());
    }
  }
}

}  // namespace

bool mayKnow(const Place& from, const Place& to) {
  return !to.is_main && (to.module == from.module || to.layer < from.layer);
}

Layers::Layers(const std::filesystem::path& root, Violations& violations) {
  static const std::regex pattern(R"(# (\S+) \((?:layer (\d)|part of (\S+)|modules)\)(?:: .*)?)");
  std::map<std::string, std::string> parts;
  forEachFile(root, [&](const std::filesystem::path& path, const std::string& name) {
    if (path.filename() != "README.md") return;
    const std::string folder = std::filesystem::path(name).parent_path().generic_string();
    std::ifstream stream(path);
    std::string line;
    std::getline(stream, line);
    std::smatch match;
    if (!std::regex_match(line, match, pattern) || match[1] != folder)
      violations.push_back(name + " begins with \"" + line + "\": write # " + folder + " and its place");
    else if (match[2].matched)
      layer_of_[folder] = std::stoi(match[2]);
    else if (match[3].matched)
      parts[folder] = match[3];
  });
  for (const auto& [folder, module] : parts)
    if (const auto place = placeOf(folder); !place || place->module != module)
      violations.push_back(folder + "/README.md: not a part of " + module);
}

std::optional<Place> Layers::placeOf(const std::string& path) const {
  const std::filesystem::path whole(path);
  auto module = layer_of_.end();
  for (auto folder = whole; !folder.empty() && module == layer_of_.end(); folder = folder.parent_path())
    module = layer_of_.find(folder.generic_string());
  if (module == layer_of_.end()) return std::nullopt;
  const std::string file = whole.filename().string();
  const bool is_main = file == "main.cpp" || file.ends_with("_main.cpp");
  return Place{module->first, is_main ? std::max(module->second, kPrograms) : module->second, is_main};
}

IncludeEdges readIncludes(const std::filesystem::path& root, Violations& violations) {
  static const std::regex pattern(R"re(^\s*#\s*include\s*(["<])([^">]+)[">])re");
  IncludeEdges edges;
  forEachFile(root, [&](const std::filesystem::path& path, const std::string& file) {
    if (!isSource(path)) return;
    std::ifstream stream(path);
    for (std::string line; std::getline(stream, line);) {
      std::smatch match;
      if (!std::regex_search(line, match, pattern)) continue;
      const std::string included = std::filesystem::path(match[2].str()).lexically_normal().generic_string();
      const std::string top = included.substr(0, included.find('/'));
      const bool from_root =
          std::find(kFolders.begin(), kFolders.end(), top) != kFolders.end() || top == "tests";
      if (from_root && std::filesystem::exists(root / top))
        edges.insert({file, included});
      else if (match[1] == "\"" && std::filesystem::exists(path.parent_path() / included))
        violations.push_back(file + " includes \"" + match[2].str() + "\": write it from the project's root");
    }
  });
  return edges;
}

Violations Layers::checkIncludes(const IncludeEdges& edges) const {
  Violations violations;
  for (const auto& [file, included] : edges) {
    const auto from = placeOf(file), to = placeOf(included);
    if (!from)
      violations.push_back(file + " is in none of the modules");
    else if (!to)
      violations.push_back(file + " includes " + included + ", which is in none of the modules");
    else if (!mayKnow(*from, *to))
      violations.push_back(file + " (" + describe(*from) + ") includes " + included + " (" + describe(*to) +
                           ")");
  }
  return violations;
}

Violations findCycles(const IncludeEdges& edges) {
  std::map<std::string, std::vector<std::string>> next;
  for (const auto& [from, to] : edges) next[from].push_back(to);
  Violations cycles;
  std::set<std::string> done;
  std::vector<std::string> path;
  const std::function<void(const std::string&)> visit = [&](const std::string& file) {
    if (const auto again = std::find(path.begin(), path.end(), file); again != path.end()) {
      std::string line;
      for (auto it = again; it != path.end(); ++it) line += *it + " -> ";
      cycles.push_back(line + file);
      return;
    }
    if (done.count(file) != 0) return;
    path.push_back(file);
    for (const std::string& to : next[file]) visit(to);
    path.pop_back();
    done.insert(file);
  };
  for (const auto& edge : edges) visit(edge.first);
  return cycles;
}

std::map<std::string, Target> readTargets(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw std::runtime_error(file.string() + ": no list of targets; configure again");
  std::map<std::string, Target> targets;
  for (std::string line; std::getline(stream, line);) {
    std::istringstream fields(line);
    std::string name, libraries;
    Target target;
    std::getline(fields, name, '|');
    std::getline(fields, target.type, '|');
    std::getline(fields, target.folder, '|');
    std::getline(fields, libraries);
    // Names may stand inside generator expressions, as $<LINK_ONLY:name>.
    static const std::regex word("[A-Za-z0-9_.+-]+");
    for (std::sregex_iterator it(libraries.begin(), libraries.end(), word), none; it != none; ++it)
      target.libraries.insert(it->str());
    targets[name] = target;
  }
  return targets;
}

Violations checkTargets(const Layers& layers, const std::map<std::string, Target>& targets) {
  const auto placeOfTarget = [&](const Target& target) {
    return layers.placeOf(target.type == "EXECUTABLE" ? target.folder + "/main.cpp" : target.folder);
  };
  Violations violations;
  for (const auto& [name, target] : targets) {
    const auto from = placeOfTarget(target);
    if (!from) continue;  // tests and their support may link anything
    for (const std::string& library : target.libraries) {
      const auto known = targets.find(library);
      if (known == targets.end() || library == name) continue;  // a library of the system
      const auto to = placeOfTarget(known->second);
      if (!to)
        violations.push_back(name + " links " + library + ", which is in none of the modules");
      else if (!mayKnow(*from, *to))
        violations.push_back(name + " (" + describe(*from) + ") links " + library + " (" + describe(*to) +
                             ")");
    }
  }
  return violations;
}

}  // namespace fathom::test
