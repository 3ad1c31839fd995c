#pragma once

#include <filesystem>

namespace fathom::topside {

// The finest tiles' pictures seen from straight above, north up, with cells of one texel: red, green, blue
// and alpha as a GeoTIFF in the dive's own system, tile by tile, so that memory does not grow with the dive.
// A tile without a picture has the colours of its vertices. Throws InputError for results without tiles.
void drawTilesFromAbove(const std::filesystem::path& path, const std::filesystem::path& results);

}  // namespace fathom::topside
