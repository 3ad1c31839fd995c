#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/products/tables/dive_track.hpp"

namespace fathom::topside {

// Corners of an image on a level plane `range` below the camera [m], clockwise from the top left one: north,
// east, depth. Empty where a corner's ray does not reach it within four times that distance.
[[nodiscard]] std::vector<Eigen::Vector3d> footprintOnPlane(const Camera& camera, const SE3& T_nav_cam,
                                                            double range);

// track.json and images.json, as the viewer's page reads them (README.md of this folder).
// `timed` false: times count from the first image.
void writeTrackJson(const std::filesystem::path& path, const std::vector<DiveTrackPoint>& track, bool timed);
void writeImagesJson(const std::filesystem::path& path, const std::vector<ImageRow>& images,
                     const Camera& camera);

// Tables of images, one row a left image, for annotation tools, in `folder`:
//   images.csv          everything, both images, names with units
//   images_squidle.csv  Squidle+: key, timestamp_start, pose.lat, pose.lon, pose.dep, pose.alt, pose.data.*
//   images_catami.csv   CATAMI data package 1.0 (images.csv there): no header, -999 for what is unknown
//   images_biigle.csv   BIIGLE image metadata: filename, taken_at, lng, lat, gps_altitude, ...
// Without `origin` nobody knows where the dive was. What is not known stays empty. Returns the names written.
std::vector<std::string> writeImageTables(const std::filesystem::path& folder,
                                          const std::optional<Geodetic>& origin,
                                          const std::vector<ImageRow>& images);

}  // namespace fathom::topside
