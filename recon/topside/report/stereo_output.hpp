#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/image_view.hpp"
#include "recon/stereo/sparse_stereo.hpp"

namespace fathom::topside {

// Stereo points as CSV with the header u_left,v_left,u_right,v_right,x_m,y_m,z_m,sigma_z_m: distorted pixels,
// and the left camera frame.
void writePointsCsv(const std::filesystem::path& path, const stereo::StereoResult& result);

// What one pair gave, for --json and the printed lines.
struct PairReport {
  std::string method;  // "sparse" or "dense"
  stereo::SeedPlane plane;
  bool plane_found = false;                              // by a wide search, not from a given altitude
  std::vector<std::pair<std::string, double>> stage_ms;  // wall clock, in order
};
[[nodiscard]] std::string pairJson(const stereo::StereoResult& result, const PairReport& report);
[[nodiscard]] std::string pairText(const stereo::StereoResult& result, const PairReport& report);

// PNG bytes: the left image in grey with the triangles coloured by depth, and a scale in metres.
[[nodiscard]] std::string depthPicture(const stereo::StereoResult& result, const ImageView& left_mono);

}  // namespace fathom::topside
