#pragma once

#include <filesystem>

#include "telemetry/web/page_server.hpp"

namespace fathom::topside {

struct ServedDive {
  std::filesystem::path output;          // holds scene.json
  std::filesystem::path images;          // the original images, as scene.json says; empty: it names none
  [[nodiscard]] bool hasImages() const;  // they are there
};

// Finds the parts from what the user gave: an output folder, or the mission folder that holds one in
// topside/. The image folder is the one that scene.json names, from the output folder. Throws InputError
// where there is no scene.json, or it is none.
[[nodiscard]] ServedDive findDive(const std::filesystem::path& folder);

// Serves a dive to browsers on this machine (127.0.0.1 alone): `/` the page, `/dive/` the output, `/images/`
// where they are, `/view.json`, which tells the page so, and `/crs/28355`, the projection of an EPSG code as
// proj4 reads it. Nothing can be changed through it. A dive may come from anyone: of the image folder
// pictures alone are served, and no file of either can run in the browser. Port 0: any that is free; throws
// InputError where it cannot be had.
[[nodiscard]] web::PageServer serveDive(const ServedDive& dive, const std::filesystem::path& page, int port);

}  // namespace fathom::topside
