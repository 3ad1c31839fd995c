#pragma once

#include <filesystem>
#include <string>

#include "sim/score/colour_score.hpp"

namespace fathom::sim {

// Table of a product's colour errors by range, depth and height in the image: each in three classes of equal
// count with the bounds between them, the median and 95 % quantile of each class, and the correlation of the
// signed error of lightness (CIE L*). Then a line for each colour of the truth that covers kFewestSquares.
[[nodiscard]] std::string colourDetail(const ColourScore& score);
inline constexpr std::size_t kFewestSquares = 20;

// Class of a colour by lightness, chroma and hue in CIE L*a*b*: "dark", "white", "grey", "pink", "brown",
// "beige", "green", "blue" or "violet".
[[nodiscard]] const char* colourName(const Eigen::Vector3d& lab);

// Writes one PNG: truth, product after its white balance, and error (0 to kMostError) side by side in plan,
// north up; each square of the score is several pixels wide.
void writeColourMap(const std::filesystem::path& file, const ColourScore& score);
inline constexpr double kMostError = 15;

}  // namespace fathom::sim
