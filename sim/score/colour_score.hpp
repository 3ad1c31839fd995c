#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "sim/score/truth_surface.hpp"

namespace fathom::sim {

// One square in plan: linear colours of the truth and of the product after its white balance.
struct ColourCell {
  Eigen::Vector3d point, truth, product;  // point: in the truth's nav [m]
  double error = 0;                       // CIEDE2000
  double range = 0, depth = 0;            // from the nearest camera; [m]
  double height = 0;                      // in that camera's image, 0 top to 1 bottom; NaN: outside of it
};

// Pearson's; 0 where one of them does not vary.
[[nodiscard]] double correlation(const std::vector<double>& a, const std::vector<double>& b);

// Errors of a product's colours against the truth's albedo (CIEDE2000), over squares of kColourCell in plan,
// after one gain for each channel in linear light, since images do not determine white balance and exposure.
struct ColourScore {
  double median = 0, p95 = 0;
  double chroma = 0;                                // median distance in a*, b* alone
  double with_depth = 0, with_range = 0;            // correlation of the error with these
  Eigen::Vector3d gains = Eigen::Vector3d::Ones();  // red, green, blue
  std::vector<ColourCell> squares;
};
inline constexpr double kColourCell = 0.05;  // [m]

// A point of a product [nav, m] with its colour (linear).
struct ColouredPoint {
  Eigen::Vector3d point;
  Eigen::Vector3d linear;
};
// Spread evenly over a mesh's triangles; empty without colours.
[[nodiscard]] std::vector<ColouredPoint> colouredPoints(const Mesh& mesh);
// Pixels of an image from above (GDAL, local north and east), with depths of the truth below them. Throws
// InputError for what is no such image.
[[nodiscard]] std::vector<ColouredPoint> colouredPoints(const std::filesystem::path& orthomosaic,
                                                        const TruthSurface& truth, const SE3& T_truth_nav);

// `T_truth_nav` maps the product's points onto the truth. `camera`, `cameras`: the camera of the images and
// its poses in nav. None where no square has points.
[[nodiscard]] std::optional<ColourScore> scoreColours(const std::vector<ColouredPoint>& points,
                                                      const TruthSurface& truth, const SE3& T_truth_nav,
                                                      const Camera& camera, const std::vector<SE3>& cameras);

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
