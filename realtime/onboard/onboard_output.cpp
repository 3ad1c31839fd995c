#include "realtime/onboard/onboard_output.hpp"

#include <array>
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
constexpr std::array<std::string_view, 7> kOurs = {"packets.bin",  "health.csv",           "map.ply",
                                                   "odometry.csv", "stereo_pose_est.data", "report.json",
                                                   "timing.json"};

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
}

void OnboardOutput::addPacket(std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
  if (!telemetry::writePacket(packets_, utc_ns, frame))
    throw std::runtime_error("cannot write packets.bin in " + folder_.path().string());
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
  if (packets_.fail() || health_.fail())
    throw std::runtime_error("cannot write into " + folder_.path().string() + " (disk full?)");
  folder_.commit();
}

}  // namespace fathom::onboard
