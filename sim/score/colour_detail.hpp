#pragma once

#include <filesystem>
#include <string>

#include "sim/score/colour_score.hpp"

namespace fathom::sim {

// Where a product's colours are off: a line each for range, depth and height in the image, in three classes
// of equal count with the bounds between them, each class's median and 95 %, and how the signed error of
// lightness (CIE L*) is correlated with it. Then a line for each colour of the truth that covers
// kFewestSquares.
[[nodiscard]] std::string colourDetail(const ColourScore& score);
inline constexpr std::size_t kFewestSquares = 20;

// "dark", "white", "grey", "pink", "brown", "beige", "green", "blue" or "violet": of a truth's colour, by
// lightness, chroma and hue in CIE L*a*b*.
[[nodiscard]] const char* colourName(const Eigen::Vector3d& lab);

// One PNG: the truth, the product after its one white balance, and the error (0 to kMostError) side by side
// in plan, north up, a square of the score as several pixels.
void writeColourMap(const std::filesystem::path& file, const ColourScore& score);
inline constexpr double kMostError = 15;

}  // namespace fathom::sim
