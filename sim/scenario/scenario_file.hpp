#pragma once

#include <filesystem>
#include <string>

#include "sim/scenario/scenario.hpp"

namespace fathom::sim {

// Reads a scenario: a path, or the bare name of a shipped one ("reef-quick"). Throws InputError that names
// file, key (and line) and fix: an absent or empty file, an unknown key, a value of a wrong type or out of
// range, a mesh that is not there.
[[nodiscard]] Scenario loadScenario(const std::string& name_or_path);

// Folder of the shipped scenarios.
[[nodiscard]] std::filesystem::path shippedScenarios();
// Folder of real captures: the environment variable FATHOM_DATA_DIR, else share/fathom/data of the
// installation.
[[nodiscard]] std::filesystem::path dataFolder();

// The terrain with relative file names found beside the scenario's file or in the folder of real captures.
// Throws InputError.
[[nodiscard]] TerrainConfig resolvedTerrain(const Scenario& scenario);

// The scenario as TOML: every key with its value, unit, range, default and meaning. Loading it gives the same
// scenario.
[[nodiscard]] std::string scenarioToml(const Scenario& scenario);

}  // namespace fathom::sim
