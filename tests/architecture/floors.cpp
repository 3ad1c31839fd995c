#include "tests/architecture/floors.hpp"

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

constexpr std::array<std::string_view, 5> kHouse{"firmware_if", "realtime", "recon", "telemetry", "sim"};
constexpr int kMiddleFloor = 2, kRoof = 4;

const std::map<std::string, int>& namedRooms() {
  static const std::map<std::string, int> rooms{{"realtime/kernel", 0},
                                                {"recon/geometry", 1},
                                                {"firmware_if", kMiddleFloor},
                                                {"telemetry", kMiddleFloor},
                                                {"sim", 3},
                                                {"realtime/onboard", kRoof},
                                                {"recon/topside", kRoof},
                                                {"telemetry/monitor", kRoof}};
  return rooms;
}

std::string describe(const Place& place) {
  return (place.is_main ? "main of " : "") + place.room + ", floor " + std::to_string(place.floor);
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

}  // namespace

std::optional<Place> placeOf(const std::string& path) {
  std::vector<std::string> parts;
  for (const auto& part : std::filesystem::path(path)) parts.push_back(part.string());
  if (parts.empty() || std::find(kHouse.begin(), kHouse.end(), parts[0]) == kHouse.end()) return std::nullopt;

  Place place;
  const std::string two = parts.size() > 1 ? parts[0] + "/" + parts[1] : parts[0];
  if (const auto named = namedRooms().find(two); named != namedRooms().end()) {
    place = {named->first, named->second};
  } else if (const auto whole = namedRooms().find(parts[0]); whole != namedRooms().end()) {
    place = {whole->first, whole->second};
  } else if (parts[0] == "recon" && parts.size() > 1 && parts[1].find('.') == std::string::npos) {
    place = {two, kMiddleFloor};
  } else {
    return std::nullopt;
  }
  if (parts.back() == "main.cpp" || parts.back().ends_with("_main.cpp")) {
    place.floor = kRoof;
    place.is_main = true;
  }
  return place;
}

bool mayKnow(const Place& from, const Place& to) {
  // Nobody includes a main; a main is not of its room for others.
  return !to.is_main && (to.room == from.room || to.floor < from.floor);
}

IncludeEdges readIncludes(const std::filesystem::path& root, Violations& violations) {
  static const std::regex pattern(R"re(^\s*#\s*include\s*(["<])([^">]+)[">])re");
  IncludeEdges edges;
  for (const std::string_view folder : kHouse) {
    if (!std::filesystem::exists(root / folder)) continue;
    std::filesystem::recursive_directory_iterator entry(root / folder), end;
    for (; entry != end; ++entry) {
      if (entry->is_directory() && isForeign(entry->path())) entry.disable_recursion_pending();
      if (!entry->is_regular_file() || !isSource(entry->path())) continue;
      const std::string file = entry->path().lexically_relative(root).generic_string();
      std::ifstream stream(entry->path());
      for (std::string line; std::getline(stream, line);) {
        std::smatch match;
        if (!std::regex_search(line, match, pattern)) continue;
        const std::string included =
            std::filesystem::path(match[2].str()).lexically_normal().generic_string();
        const std::string top = included.substr(0, included.find('/'));
        const bool from_root = std::find(kHouse.begin(), kHouse.end(), top) != kHouse.end() || top == "tests";
        if (from_root && std::filesystem::exists(root / top))
          edges.insert({file, included});
        else if (match[1] == "\"" && std::filesystem::exists(entry->path().parent_path() / included))
          violations.push_back(file + " includes \"" + match[2].str() +
                               "\": write it from the project's root");
      }
    }
  }
  return edges;
}

Violations checkIncludes(const IncludeEdges& edges) {
  Violations violations;
  for (const auto& [file, included] : edges) {
    const auto from = placeOf(file), to = placeOf(included);
    if (!from)
      violations.push_back(file + " is in none of the rooms");
    else if (!to)
      violations.push_back(file + " includes " + included + ", which is in none of the rooms");
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
  std::vector<std::string> way;
  const std::function<void(const std::string&)> visit = [&](const std::string& file) {
    if (const auto again = std::find(way.begin(), way.end(), file); again != way.end()) {
      std::string line;
      for (auto it = again; it != way.end(); ++it) line += *it + " -> ";
      cycles.push_back(line + file);
      return;
    }
    if (done.count(file) != 0) return;
    way.push_back(file);
    for (const std::string& to : next[file]) visit(to);
    way.pop_back();
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

Violations checkTargets(const std::map<std::string, Target>& targets) {
  const auto placeOfTarget = [](const Target& target) {
    return placeOf(target.type == "EXECUTABLE" ? target.folder + "/main.cpp" : target.folder);
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
        violations.push_back(name + " links " + library + ", which is in none of the rooms");
      else if (!mayKnow(*from, *to))
        violations.push_back(name + " (" + describe(*from) + ") links " + library + " (" + describe(*to) +
                             ")");
    }
  }
  return violations;
}

}  // namespace fathom::test
