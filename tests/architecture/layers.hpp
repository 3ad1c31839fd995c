#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fathom::test {

using Violations = std::vector<std::string>;

// Where a file belongs. A module may know itself and every module of a lower layer, nothing else.
struct Place {
  std::string module;  // "recon/stereo"
  int layer = 0;
  bool is_main = false;  // a program's main, main.cpp or *_main.cpp beside its module: nobody includes it
};
bool mayKnow(const Place& from, const Place& to);

// The modules, each as the first line of its folder's README.md has it:
//   # recon/solver (layer 3)                      a module
//   # firmware_if/can (part of firmware_if): CAN  a folder of one
//   # recon (modules)                             a folder that only holds modules
class Layers {
 public:
  static constexpr int kPrograms = 6;  // a main is in this layer at least

  // `violations` gets every README.md below the five folders whose first line says none of these, or what is
  // not so.
  Layers(const std::filesystem::path& root, Violations& violations);

  // A file or folder, written from the project's root; std::nullopt when it is in none of the modules.
  [[nodiscard]] std::optional<Place> placeOf(const std::string& path) const;

  // Edges "from -> to" that the layers forbid, with the reason, a line each.
  [[nodiscard]] Violations checkIncludes(const std::set<std::pair<std::string, std::string>>& edges) const;

 private:
  std::map<std::string, int> layer_of_;
};

// Includes of every C and C++ file in the five folders, as (file, included file), both from the root.
// `violations` gets includes written relative to the including file.
using IncludeEdges = std::set<std::pair<std::string, std::string>>;
IncludeEdges readIncludes(const std::filesystem::path& root, Violations& violations);
// Files that include themselves in the end, one line a cycle: "a -> b -> a".
Violations findCycles(const IncludeEdges& edges);

// A target as CMake's configuration wrote it: "name|type|source folder|libraries".
struct Target {
  std::string type, folder;
  std::set<std::string> libraries;
};
std::map<std::string, Target> readTargets(const std::filesystem::path& file);
Violations checkTargets(const Layers& layers, const std::map<std::string, Target>& targets);

}  // namespace fathom::test
