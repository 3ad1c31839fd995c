#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

#include "recon/geometry/geodesy.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::io {

// stereo_pose_est.data, version 2: pose of the stereo (left camera) frame in nav. A blank in an image's name
// stands in the file as %20, a % as %25.
struct StereoPose {
  int id = 0;
  double utc_s = 0;
  SE3 T_nav_cam;
  std::string left_image, right_image;
  double altitude = 0;          // [m], 0 unknown
  double footprint_radius = 0;  // [m]
  bool likely_crossover = false;
};
struct StereoPoseFile {
  Geodetic origin;
  std::vector<StereoPose> poses;
};
// vehicle_pose_est.data, version 3: pose of body in nav.
struct VehiclePose {
  int id = 0;
  double utc_s = 0;
  SE3 T_nav_body;
  double altitude = 0;  // [m], 0 unknown
};
struct VehiclePoseFile {
  Geodetic origin;
  std::vector<VehiclePose> poses;
};

// Readers throw InputError (file, line, fix); version 1 is refused with the reason. Writers write to a
// temporary name, then rename; latitude and longitude are derived from north and east.
[[nodiscard]] StereoPoseFile readStereoPoses(const std::filesystem::path& path);
void writeStereoPoses(const std::filesystem::path& path, const StereoPoseFile& file);
[[nodiscard]] VehiclePoseFile readVehiclePoses(const std::filesystem::path& path);
void writeVehiclePoses(const std::filesystem::path& path, const VehiclePoseFile& file);

// pose_covariances.csv: left_image and, in rows, the upper triangle of the covariance of a camera's error
// along and about north, east and down [m, rad].
struct PoseCovariance {
  std::string left_image;
  Matrix6d covariance = Matrix6d::Zero();
};
[[nodiscard]] std::vector<PoseCovariance> readPoseCovariances(const std::filesystem::path& path);
void writePoseCovariances(const std::filesystem::path& path, const std::vector<PoseCovariance>& poses);

// trajectory.csv and odometry.csv: utc_ns,north_m,east_m,depth_m,qw,qx,qy,qz (body in nav, or in odom).
struct TrajectoryPoint {
  std::int64_t utc_ns = 0;
  SE3 pose;
};
[[nodiscard]] std::vector<TrajectoryPoint> readTrajectory(const std::filesystem::path& path);
void writeTrajectory(const std::filesystem::path& path, const std::vector<TrajectoryPoint>& points);
// The same line by line, into a file that grows. Throw std::runtime_error for a pose that is not finite.
void writeTrajectoryHead(std::ostream& out);
void writeTrajectoryPoint(std::ostream& out, const TrajectoryPoint& point);

}  // namespace fathom::io
