#pragma once

#include <filesystem>

namespace fathom::bench {

// What can be done with a single image: its statistics cannot tell the light's pattern from the scene. Draws
// the image as it is, under the whole image's mean and deviation (what LightingModel does after one image),
// and divided by a smooth surface, log b = quadratic in x and y, fitted robustly to the means of 24 x 20
// cells by colour: that takes a broad cone of light out, and with it any slope of brightness that the
// seafloor has. Prints how much of the cells' variance (in logarithms) the surface explains. Throws
// InputError.
void correctOneImage(const std::filesystem::path& image, const std::filesystem::path& png);

}  // namespace fathom::bench
