#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/dive.hpp"

namespace fathom::topside {

// Where a run reads, works and writes; empty: MISSION/topside.work and MISSION/topside.
struct RunPlaces {
  std::filesystem::path mission, work, out;
  InputOptions input;
};

struct Summary {
  std::size_t pairs = 0, used = 0, unreadable = 0;
  std::size_t triangles = 0, tiles = 0;
  double area = 0;     // [m^2]
  double seconds = 0;  // in all
  Digest content;      // of all files written but the report, which tells times
  std::filesystem::path out;
  std::vector<std::string> to_know;  // what is wrong with it or missing, the most important first
};

// Everything from a recorded dive to `out`: localisation, stereo, fusion, tiles, layers, report. What the
// work folder holds already is not made again. Everything appears in `out` at once, at the end. Throws
// InputError for a dive that cannot be used: a file absent or broken, or no pair that gives a mesh.
Summary runTopside(const RunPlaces& places, const TopsideConfig& config);
// The same with the usual work folder, MISSION/topside.work, beside `out`.
Summary runTopside(const std::filesystem::path& mission, const std::filesystem::path& out,
                   const TopsideConfig& config);

// What a run would find, without a result: nothing is written.
struct RunCheck {
  std::size_t pairs = 0, left_alone = 0, right_alone = 0;
  std::size_t looked = 0;               // pairs whose images were read, spread over the dive
  std::vector<std::string> unreadable;  // of these, a line each
  double seconds = 0;  // that a run from the start takes on these threads, by a few pairs [s]; 0: not known
};
// Throws InputError where runTopside() would before its work begins.
[[nodiscard]] RunCheck checkRun(const RunPlaces& places, const TopsideConfig& config);

// One stage, or some of its items, into the work folder; the stages before it must be there. Several
// processes may do so at once.
void runOneStage(const RunPlaces& places, const TopsideConfig& config, Stage stage,
                 std::optional<std::pair<std::size_t, std::size_t>> items);

// How many items the stages have, as JSON: {"prepare": 20, "piece": 7}; pieces once there is a plan.
[[nodiscard]] std::string listItems(const RunPlaces& places, const TopsideConfig& config);

}  // namespace fathom::topside
