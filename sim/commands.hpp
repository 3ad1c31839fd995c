#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// A command of fathom-sim as the parser has it, and what runs it when it was chosen: gives the exit code,
// throws InputError.
struct Command {
  CLI::App* parsed;
  std::function<int()> run;
};

Command addRenderCommand(CLI::App& app);      // makes a mission folder
Command addControlCommand(CLI::App& app);     // surveys points on a dive's seafloor
Command addKeysCommand(CLI::App& app);        // prints every key of a scenario
Command addScoreCommand(CLI::App& app);       // how far what was estimated lies from the truth
Command addChannelCommand(CLI::App& app);     // relays frames through simulated water
Command addCameraCommand(CLI::App& app);      // is a GigE Vision camera
Command addPictureCommand(CLI::App& app);     // draws a mesh
Command addBoardsCommand(CLI::App& app);      // photographs a chessboard
Command addHilCommand(CLI::App& app);         // plays a mission through real interfaces
Command addCampaignCommand(CLI::App& app);    // dives many times in disturbed seas
Command addHilCompareCommand(CLI::App& app);  // holds such a run to its replays
Command addReplayCommand(CLI::App& app);      // replays the vehicle's cores with a simulated ship

}  // namespace fathom::sim
