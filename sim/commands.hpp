#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::sim {

// One command of fathom-sim: its parser, and the function that runs it and gives the exit code (throws
// InputError).
struct Command {
  CLI::App* parser;
  std::function<int()> run;
};

Command addRenderCommand(CLI::App& app);      // makes a mission folder
Command addControlCommand(CLI::App& app);     // writes surveyed points of a dive's seafloor
Command addKeysCommand(CLI::App& app);        // prints every key of a scenario
Command addScoreCommand(CLI::App& app);       // errors of estimates against the truth
Command addChannelCommand(CLI::App& app);     // relays frames through simulated water
Command addCameraCommand(CLI::App& app);      // serves a simulated GigE Vision camera
Command addPictureCommand(CLI::App& app);     // draws a mesh
Command addBoardsCommand(CLI::App& app);      // photographs a chessboard
Command addHilCommand(CLI::App& app);         // plays a mission through real interfaces
Command addCampaignCommand(CLI::App& app);    // simulates many disturbed dives
Command addHilCompareCommand(CLI::App& app);  // compares such a run with its replays
Command addReplayCommand(CLI::App& app);      // replays a mission with a simulated ship

}  // namespace fathom::sim
