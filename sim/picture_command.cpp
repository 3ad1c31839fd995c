#include <cstdio>
#include <memory>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "sim/commands.hpp"
#include "sim/picture/picture.hpp"

namespace fathom::sim {
namespace {

// Said before the work, not after it.
void requireWritable(const std::filesystem::path& png) {
  std::error_code error;
  if (std::filesystem::is_directory(png, error))
    throw InputError("--out", png.string(), "is a folder; name a PNG file");
  if (png.has_parent_path() && !std::filesystem::is_directory(png.parent_path(), error))
    throw InputError("--out", png.string(),
                     "lies in no folder; make " + png.parent_path().string() + " first");
}

}  // namespace

Command addPictureCommand(CLI::App& app) {
  struct State {
    std::filesystem::path mesh, png;
    std::string view = "oblique", size = "1280x960";
  };
  const auto state = std::make_shared<State>();
  CLI::App* command = app.add_subcommand("picture", "draw a PLY mesh as a PNG");
  command->footer(
      "Example: fathom-sim picture missions/reef-grid/topside/mesh.ply --out mesh.png --view oblique");
  command->add_option("mesh", state->mesh, "PLY mesh in nav: north, east, down [m]")->required();
  command->add_option("--out", state->png, "PNG to write")->required();
  command->add_option("--view", state->view, "top or oblique")
      ->check(CLI::IsMember({"top", "oblique"}))
      ->capture_default_str();
  command->add_option("--size", state->size, "WxH [px]")->capture_default_str();
  return {command, [state] {
            PictureOptions options;
            options.view = state->view == "top" ? PictureOptions::View::kTop : PictureOptions::View::kOblique;
            int used = 0;
            if (std::sscanf(state->size.c_str(), "%5dx%5d%n", &options.width, &options.height, &used) != 2 ||
                static_cast<std::size_t>(used) != state->size.size())
              throw InputError("--size", state->size, "is not WxH, such as 1280x960");
            requireWritable(state->png);
            drawPicture(state->mesh, state->png, options);
            return static_cast<int>(kExitSuccess);
          }};
}

}  // namespace fathom::sim
