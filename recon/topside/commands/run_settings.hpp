#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>

#include "recon/topside/pipeline.hpp"

namespace fathom::topside {

// What can be said about a run on the command line.
struct RunSettings {
  RunPlaces places;
  std::filesystem::path config;
  std::optional<double> resolution, texel;
  std::optional<int> features, jobs;
  bool dense = false, no_slam = false, no_bundle = false, no_texture = false;
  std::string textures = "jpeg", mode = "bands";
};

// The options that poses and features depend on; and all, with the mission's folder.
void addPoseSettings(CLI::App& command, RunSettings& settings);
void addRunSettings(CLI::App& command, RunSettings& settings);

// The configuration's file, and over it what the command line says. Throws InputError. Hands the pairing
// tolerance, which a configuration may hold, to the places.
[[nodiscard]] TopsideConfig configOf(RunSettings& settings);

}  // namespace fathom::topside
