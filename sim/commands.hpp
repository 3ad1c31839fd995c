#pragma once

#include "realtime/base/command_line.hpp"

namespace fathom::sim {

// The commands of fathom-sim.
void addRenderCommand(CommandLine& app);      // makes a mission folder
void addControlCommand(CommandLine& app);     // writes surveyed points of a dive's seafloor
void addKeysCommand(CommandLine& app);        // prints every key of a scenario
void addScoreCommand(CommandLine& app);       // errors of estimates against the truth
void addChannelCommand(CommandLine& app);     // relays frames through simulated water
void addCameraCommand(CommandLine& app);      // serves a simulated GigE Vision camera
void addPictureCommand(CommandLine& app);     // draws a mesh
void addBoardsCommand(CommandLine& app);      // photographs a chessboard
void addHilCommand(CommandLine& app);         // plays a mission through real interfaces
void addCampaignCommand(CommandLine& app);    // simulates many disturbed dives
void addHilCompareCommand(CommandLine& app);  // compares such a run with its replays
void addReplayCommand(CommandLine& app);      // replays a mission with a simulated ship

}  // namespace fathom::sim
