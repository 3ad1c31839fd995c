#pragma once

#include <filesystem>

namespace fathom::sim {

struct PictureOptions {
  enum class View { kTop, kOblique };
  View view = View::kOblique;
  int width = 1280;  // [px], 64 to 16384
  int height = 960;  // [px], likewise
};

// Draws a PLY mesh (nav frame, z down) as a PNG with its colours, or coloured by depth with a legend; lit by
// a sun and a sky with ambient occlusion; parallel projection with a scale bar. Top: north is up. Oblique:
// from the south, 42 degrees over the horizon. Throws InputError for a mesh or size that cannot be used.
void drawPicture(const std::filesystem::path& mesh, const std::filesystem::path& png,
                 const PictureOptions& options);

}  // namespace fathom::sim
