#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace fathom::topside {

// `fathom-topside stereo`: one pair of images, without a mission, to a mesh, a list of points and a picture.
// Gives what to run once the command line has been parsed.
[[nodiscard]] std::function<int()> addStereoCommand(CLI::App& app, CLI::App*& command);

}  // namespace fathom::topside
