#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace fathom::test {

// The floors of the house. A room may know itself and every room on a lower floor, nothing else:
//   0 realtime/kernel, 1 recon/geometry, 2 recon/* firmware_if telemetry,
//   4 the roofs: realtime/onboard, recon/topside, telemetry/monitor, the folders of sim, and each program's
//   main (main.cpp or *_main.cpp) beside its room,
//   5 the bench: fathom-sim, the files of sim itself, which plays missions to the other programs' cores.
// So nothing that goes to sea or runs after it knows the simulator.
struct Place {
  std::string room;  // "recon/stereo"
  int floor = 0;
  bool is_main = false;  // a program's main: on the roof, and it knows its own room
};

// Where a file or folder, written from the project's root, belongs; std::nullopt when it is in none of the
// rooms.
std::optional<Place> placeOf(const std::string& path);
bool mayKnow(const Place& from, const Place& to);

// One edge "from -> to" that the floors forbid, with the reason, as a line of text.
using Violations = std::vector<std::string>;

// Includes of every C and C++ file in the five folders, as (file, included file), both from the root.
// `violations` gets includes written relative to the including file.
using IncludeEdges = std::set<std::pair<std::string, std::string>>;
IncludeEdges readIncludes(const std::filesystem::path& root, Violations& violations);
Violations checkIncludes(const IncludeEdges& edges);
// Files that include themselves in the end, one line a cycle: "a -> b -> a".
Violations findCycles(const IncludeEdges& edges);

// A target as CMake's configuration wrote it: "name|type|source folder|libraries".
struct Target {
  std::string type, folder;
  std::set<std::string> libraries;
};
std::map<std::string, Target> readTargets(const std::filesystem::path& file);
Violations checkTargets(const std::map<std::string, Target>& targets);

}  // namespace fathom::test
