#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/closure/frame_features.hpp"
#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"

namespace fathom::topside {

// What structure from motion would have made of a dive: where every image was taken, and points with the
// pixels at which they were seen. World: x east, y north, z up [m], of the dive's origin; images have their
// original size and pixels, the centre of the top left one being (0, 0).

// One stereo pair. Both its cameras saw every feature, at the pixels that were measured.
struct StereoView {
  std::string left, right;  // names of the images, relative to the mission's image folder
  SE3 T_world_cam;          // of the left camera
  std::vector<closure::Feature> features;
  std::vector<std::uint32_t> point_of;  // of each feature: its point
};

// A place on the ground, and the features that are it, of different views.
struct SparsePoint {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  Rgb colour{128, 128, 128};
  float error = 0;          // mean over all its pixels of the distance to where it projects [px]
  std::uint32_t first = 0;  // of its members in SparseModel
  std::uint32_t views = 0;  // so many members, each seen by both cameras
};

struct SparseModel {
  struct Member {
    std::uint32_t view = 0, feature = 0;
  };
  std::optional<Geodetic> origin;  // none: nobody said where the dive was
  std::string placed_by;           // Anchor::source
  StereoRig rig;
  std::vector<StereoView> views;  // by time
  std::vector<SparsePoint> points;
  std::vector<Member> members;  // of all points; of each by view

  [[nodiscard]] double meanError() const;  // over all pixels [px]
};

// Pixel coordinates of other programs, whose corner pixel is centred on (0.5, 0.5), less ours.
inline constexpr double kHalfPixel = 0.5;

// The rotation from nav to that world.
[[nodiscard]] SE3 worldFromNav();
// Where the world is on the Earth, in words and as a coordinate system, for people.
[[nodiscard]] std::string originText(const SparseModel& model);

// Distance of a feature's pixels, left and right, from where a place projects [px]; infinite behind a camera.
[[nodiscard]] std::array<double, 2> pixelErrors(const StereoRig& rig, const SE3& T_world_cam,
                                                const closure::Feature& feature,
                                                const Eigen::Vector3d& place);

// Features of two views that are one place.
struct ViewMatches {
  std::uint32_t a = 0, b = 0;  // views
  std::vector<closure::Match> matches;
};

// Fills points, members and every view's point_of from the views' features. Features that matches join are
// one point, unless two of them are of one view: then a match is wrong, and each is a point of its own. A
// point's place is the mean of what its views say, weighted by their covariances; a view in which its pixels
// are more than kMostError from it is left out of it and gets a point of its own.
constexpr double kMostError = 4;  // mean of left and right [px]; COLMAP's own filter for tracks
void joinFeatures(const std::vector<ViewMatches>& links, SparseModel& model);

enum class ColmapFormat { kBinary, kText };

// A sparse model as COLMAP's tools read it, in `folder`: cameras, images and points3D (.bin or .txt), as
// colmap.github.io/format.html describes them, and origin.txt, which says where on the Earth the origin is.
// Cameras 1 and 2 are left and right, OPENCV, or FULL_OPENCV where there is a k3; images 2k + 1 and 2k + 2
// are pair k's, with the pose from world to camera; every point has a track. In COLMAP the top left pixel's
// centre is (0.5, 0.5), which principal points and pixels are moved to. The folder appears whole or not at
// all. Throws InputError where it holds other files.
void writeColmapModel(const std::filesystem::path& folder, const SparseModel& model, ColmapFormat format);

// A sparse model as nerfstudio's data parser takes it, in `folder`: transforms.json (camera model OPENCV,
// each frame with its camera's numbers and the pose from camera to world, the camera looking along -z with y
// up), points.ply, which it names as ply_file_path, and origin.txt. Images stay where they are: file_path
// leads from `folder` to `images`, the mission's image folder. The top left pixel's centre is (0.5, 0.5). The
// folder appears whole or not at all. Throws InputError where it holds other files.
void writeNerfstudioScene(const std::filesystem::path& folder, const SparseModel& model,
                          const std::filesystem::path& images);

}  // namespace fathom::topside
