#include "realtime/onboard/onboard_output.hpp"

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "telemetry/packet_log.hpp"

namespace fathom::onboard {

namespace {

// What onboard/ of a mission folder may hold.
constexpr std::array<std::string_view, 10> kOurs = {
    "packets.bin",  "downlink.bin",         "closures.csv", "health.csv",  "map.ply",
    "odometry.csv", "stereo_pose_est.data", "report.json",  "timing.json", "live.json"};

}  // namespace

OnboardOutput::OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin)
    : folder_(folder, kOurs) {
  poses_.origin = origin;
  packets_.open(folder_.path() / "packets.bin", std::ios::binary);
  health_.open(folder_.path() / "health.csv");
  if (!packets_ || !health_) throw std::runtime_error("cannot write into " + folder_.path().string());
}

void OnboardOutput::addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                                  double altitude) {
  constexpr double kNanoseconds = 1e9;  // in a second
  io::StereoPose pose;
  pose.id = static_cast<int>(output.pair_index);
  pose.utc_s = static_cast<double>(output.utc_ns) / kNanoseconds;
  pose.T_nav_cam = output.T_nav_cam;
  pose.left_image = left;
  pose.right_image = right;
  pose.altitude = altitude;
  pose.footprint_radius = output.footprint_radius;
  poses_.poses.push_back(std::move(pose));
  outputs_.push_back(output);
}

void OnboardOutput::placeStereoPoses(const std::function<SE3(const MapOutput&)>& T_nav_cam) {
  for (std::size_t i = 0; i < outputs_.size(); ++i) poses_.poses[i].T_nav_cam = T_nav_cam(outputs_[i]);
}

void OnboardOutput::writeClosures(const LocalisationCore& localisation) {
  // A keyframe is the first pair that hangs on it.
  std::vector<const std::string*> image(static_cast<std::size_t>(localisation.keyframes()));
  for (std::size_t i = outputs_.size(); i-- > 0;)
    if (outputs_[i].keyframe >= 0)
      image[static_cast<std::size_t>(outputs_[i].keyframe)] = &poses_.poses[i].left_image;
  AtomicFile file(folder_.path() / "closures.csv");
  file.stream() << "left_a,left_b,x_m,y_m,z_m,qw,qx,qy,qz,sigma_position_m,sigma_rotation_rad,inliers,chi2,"
                   "confirmed\n";
  std::array<char, 400> line{};
  for (const Closure& c : localisation.closures().closures()) {
    const std::string *a = image[static_cast<std::size_t>(c.a)], *b = image[static_cast<std::size_t>(c.b)];
    if (a == nullptr || b == nullptr) continue;
    const SE3 now = localisation.keyframePose(c.a).inverse() * localisation.keyframePose(c.b);
    const Vector6d off = (c.T_a_b.inverse() * now).log();
    const Eigen::Vector3d& t = c.T_a_b.translation();
    const Eigen::Quaterniond& q = c.T_a_b.rotation();
    std::snprintf(line.data(), line.size(), "%s,%s,%.5f,%.5f,%.5f,%.8f,%.8f,%.8f,%.8f,%.5f,%.6f,%d,%.3f,%d\n",
                  a->c_str(), b->c_str(), t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z(),
                  std::sqrt(c.covariance.topLeftCorner<3, 3>().trace() / 3),
                  std::sqrt(c.covariance.bottomRightCorner<3, 3>().trace() / 3), c.inliers,
                  off.dot(c.covariance.ldlt().solve(off)), c.confirmed ? 1 : 0);
    file.stream() << line.data();
  }
  file.commit();
}

void OnboardOutput::addPacket(std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
  if (!telemetry::writePacket(packets_, utc_ns, frame))
    throw std::runtime_error("cannot write packets.bin in " + folder_.path().string());
}

void OnboardOutput::addDownlink(std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
  if (!downlink_.is_open()) downlink_.open(folder_.path() / "downlink.bin", std::ios::binary);
  if (!telemetry::writePacket(downlink_, utc_ns, frame))
    throw std::runtime_error("cannot write downlink.bin in " + folder_.path().string());
}

void OnboardOutput::addHealth(std::int64_t utc_ns, const std::vector<std::pair<std::string, double>>& row) {
  if (!health_header_) {
    health_ << "utc_ns";
    for (const auto& [name, value] : row) health_ << ',' << name;
    health_ << '\n';
    health_header_ = true;
  }
  constexpr int kDigits = 15;  // a counter of 1e15 still prints whole
  health_ << utc_ns << std::setprecision(kDigits);
  for (const auto& [name, value] : row) health_ << ',' << value;
  health_ << '\n';
}

void OnboardOutput::writeMap(const Mesh& map_in_nav) {
  writePly(folder_.path() / "map.ply", map_in_nav, {"frame nav: x north, y east, z down [m]"});
}

void OnboardOutput::writeText(const std::string& name, const std::string& text) {
  AtomicFile file(folder_.path() / name);
  file.stream() << text;
  file.commit();
}

void OnboardOutput::commit() {
  io::writeTrajectory(folder_.path() / "odometry.csv", odometry_);
  io::writeStereoPoses(folder_.path() / "stereo_pose_est.data", poses_);
  packets_.close();
  health_.close();
  if (downlink_.is_open()) downlink_.close();
  if (packets_.fail() || health_.fail() || downlink_.fail())
    throw std::runtime_error("cannot write into " + folder_.path().string() + " (disk full?)");
  folder_.commit();
}

}  // namespace fathom::onboard
