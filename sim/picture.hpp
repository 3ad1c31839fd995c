#pragma once

#include <filesystem>

namespace fathom::sim {

struct PictureOptions {
  enum class View { kTop, kOblique };
  View view = View::kOblique;
  int width = 1280;  // [px]
  int height = 960;  // [px]
};

// Draws a PLY mesh (nav frame, z down) with its colours, or else coloured by depth with a legend; lit by a
// sun, a sky and ambient occlusion; with a scale bar. Writes a PNG. Throws InputError for a mesh that cannot
// be used.
void drawPicture(const std::filesystem::path& mesh, const std::filesystem::path& png,
                 const PictureOptions& options);

}  // namespace fathom::sim
