#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"

namespace fathom::topside {

// How much brighter each pair's left image is than its lamps, water and ground explain: strobes that do not
// flash alike, a gain or an exposure that nobody stamped. Found by vertices of two meshes at the same place,
// for neighbours along the track and `joined` couples; least squares in logarithms with a prior about 1 that
// is as wide as the ratios ask for. 1 of pairs without a coloured mesh. The same whatever the number of
// threads.
// 1 also where images differ no more than the light model leaves.
[[nodiscard]] std::vector<float> imageGains(
    const PreparedGroups& prepared, const std::vector<SE3>& T_nav_cam,
    const std::vector<std::pair<std::uint32_t, std::uint32_t>>& joined);

// What it stands on. Natural logarithm of how much brighter mesh `a` is than `b` where both have a vertex
// (both in nav, with colours); none where these are few.
[[nodiscard]] std::optional<double> logBrightness(const Mesh& a, const Mesh& b);
struct Couple {
  std::uint32_t a = 0, b = 0;
  std::optional<double> log_ratio;  // of a over b
};
[[nodiscard]] std::vector<float> gainsOf(std::size_t pairs, const std::vector<Couple>& couples);

}  // namespace fathom::topside
