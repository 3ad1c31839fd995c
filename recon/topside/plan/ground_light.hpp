#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/lighting/lighting_model.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"

namespace fathom::topside {

// What images of the same ground say of the light that each of them had.
struct GroundLight {
  // How much brighter each pair's left image is than its lamps, water and ground explain: strobes that do not
  // flash alike, a gain or an exposure that nobody stamped. 1 of pairs without a coloured mesh, and where
  // images differ no more than the light model leaves.
  std::vector<float> gains;
  // How light falls with range: ground that two images show from different ranges tells it apart from ground
  // that is dark by itself. Its share is 0 where no two images show the same ground.
  lighting::WaterLaw water;
  lighting::FallCorrection fall;  // to that law, of the left camera's colours

  static void exchange(auto& archive, auto& self) { archive(self.gains, self.water, self.fall); }
};

// Found by vertices of two meshes at the same place, for neighbours along the track and `joined` couples. Law
// by least squares on ratios of colours, with priors from the range of natural waters; gains by least squares
// in logarithms with a prior about 1 that is as wide as the ratios ask for. The same whatever the number of
// threads. `lighting`: of the left camera, by which the meshes have their colours.
[[nodiscard]] GroundLight groundLight(const PreparedGroups& prepared, const lighting::LightingModel& lighting,
                                      const std::vector<SE3>& T_nav_cam,
                                      const std::vector<std::pair<std::uint32_t, std::uint32_t>>& joined);

// Brings a mesh's colours (camera frame) to those of an image without gain and with that fall.
void relight(Mesh& mesh, double gain, const lighting::FallCorrection& fall);

// What it stands on. A place that two images show: slant range [m] and depth along the axis [m] in both,
// natural logarithm of the ratio of the first's light to the second's, red, green, blue.
struct SamePlace {
  std::array<float, 2> range{}, depth{};
  Eigen::Vector3f log_ratio = Eigen::Vector3f::Zero();
};
// Of two meshes in nav, with colours; none where these are few.
[[nodiscard]] std::vector<SamePlace> samePlaces(const Mesh& a, const Mesh& b, const SE3& T_nav_a,
                                                const SE3& T_nav_b);
struct Couple {
  std::uint32_t a = 0, b = 0;
  std::vector<SamePlace> places;
};
[[nodiscard]] std::optional<lighting::WaterLaw> waterOf(const std::vector<Couple>& couples,
                                                        const lighting::LightingModel& lighting);
[[nodiscard]] std::vector<float> gainsOf(std::size_t pairs, const std::vector<Couple>& couples,
                                         const lighting::FallCorrection& fall);

}  // namespace fathom::topside
