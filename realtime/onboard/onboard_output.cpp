#include "realtime/onboard/onboard_output.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <Eigen/Dense>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <iterator>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "recon/geometry/state_values.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::onboard {

namespace {

// What onboard/ of a mission folder may hold.
constexpr std::array<std::string_view, 10> kOurs = {
    "packets.bin",  "downlink.bin",         "closures.csv", "health.csv",  "map.ply",
    "odometry.csv", "stereo_pose_est.data", "report.json",  "timing.json", "live.json"};

constexpr std::uint32_t kTag = rt::stateTag("OUTP"), kVersion = 2;
constexpr std::size_t kPairBytes = 512;  // of a pair's record, at most, without its names

// A pair's record, for the time when its pose is known.
template <typename Archive, typename Output, typename Name, typename Altitude>
void exchangePair(Archive& archive, Output& output, Name& left, Name& right, Altitude& altitude) {
  std::uint64_t points = output.points, triangles = output.triangles, nodes = output.nodes_updated;
  archive(output.pair_index, output.utc_ns, output.T_odom_cam, output.keyframe, output.T_nav_cam,
          output.median_range, output.footprint_radius, output.min_north_east, output.max_north_east, points,
          triangles, nodes, left, right, altitude);
  if constexpr (Archive::kLoading) {
    output.points = points;
    output.triangles = triangles;
    output.nodes_updated = nodes;
  }
}

}  // namespace

OnboardOutput::OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin,
                             const OutputFolder::Life& life, double planned_hours)
    : folder_(folder, kOurs, life), planned_hours_(planned_hours) {
  poses_.origin = origin;
  for (Growing& file : files_)
    if (file.from_the_start) open(file);
  if (odometry_.tellp() == 0) io::writeTrajectoryHead(odometry_);
}

void OnboardOutput::open(Growing& file) {
  file.stream.open(folder_.path() / file.name, std::ios::binary | std::ios::app | std::ios::ate);
  if (!file.stream) throw std::runtime_error("cannot write into " + folder_.path().string());
  takeRoom(file);
}

void OnboardOutput::takeRoom(const Growing& file) {
  if (planned_hours_ <= 0) return;
  const std::filesystem::path path = folder_.path() / file.name;
  const int fd = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (fd < 0) return;
  // A file system that cannot take room beforehand is written to as it comes.
  const auto bytes = static_cast<off_t>(planned_hours_ * file.bytes_an_hour);
  (void)::fallocate(fd, FALLOC_FL_KEEP_SIZE, static_cast<off_t>(std::filesystem::file_size(path)), bytes);
  ::close(fd);
}

void OnboardOutput::giveRoomBack() {
  if (planned_hours_ <= 0) return;
  for (const Growing& file : files_) {
    const std::filesystem::path path = folder_.path() / file.name;
    std::error_code error;
    const auto bytes = std::filesystem::file_size(path, error);
    if (!error) std::filesystem::resize_file(path, bytes, error);
  }
}

void OnboardOutput::addOdometry(std::int64_t utc_ns, const SE3& T_odom_body) {
  const bool finite = T_odom_body.translation().allFinite() && T_odom_body.rotation().coeffs().allFinite();
  if (finite) io::writeTrajectoryPoint(odometry_, {utc_ns, T_odom_body});
}

void OnboardOutput::addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                                  double altitude) {
  record_.resize(kPairBytes + left.size() + right.size());
  rt::StateWriter writer(record_);
  exchangePair(writer, output, left, right, altitude);
  assert(!writer.full());
  const auto bytes = static_cast<std::uint32_t>(writer.size());
  pairs_.write(reinterpret_cast<const char*>(&bytes), sizeof bytes);
  pairs_.write(reinterpret_cast<const char*>(record_.data()), bytes);
}

void OnboardOutput::readPairs() {
  constexpr double kNanoseconds = 1e9;  // in a second
  pairs_.flush();
  std::ifstream in(folder_.path() / files_[1].name, std::ios::binary);
  std::uint32_t bytes = 0;
  poses_.poses.clear();
  outputs_.clear();
  while (in.read(reinterpret_cast<char*>(&bytes), sizeof bytes)) {
    record_.resize(bytes);
    in.read(reinterpret_cast<char*>(record_.data()), bytes);
    rt::StateReader reader(record_);
    MapOutput output;
    io::StereoPose pose;
    exchangePair(reader, output, pose.left_image, pose.right_image, pose.altitude);
    if (!in || !reader.ok())
      throw std::runtime_error("cannot read " + (folder_.path() / files_[1].name).string());
    pose.id = static_cast<int>(output.pair_index);
    pose.utc_s = static_cast<double>(output.utc_ns) / kNanoseconds;
    pose.T_nav_cam = output.T_nav_cam;
    pose.footprint_radius = output.footprint_radius;
    poses_.poses.push_back(std::move(pose));
    outputs_.push_back(output);
  }
}

void OnboardOutput::addRetired(const slam::NavigationGraph::Retired& gone) {
  record_.resize(kPairBytes);
  rt::StateWriter writer(record_);
  writer(gone.keyframe, gone.onto, gone.T_onto);
  retired_.write(reinterpret_cast<const char*>(record_.data()), static_cast<std::streamsize>(writer.size()));
}

std::map<int, slam::NavigationGraph::Retired> OnboardOutput::readRetired() {
  retired_.flush();
  std::ifstream in(folder_.path() / files_[5].name, std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
  rt::StateReader reader({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  std::vector<slam::NavigationGraph::Retired> all;
  for (slam::NavigationGraph::Retired gone;
       reader.left() > 0 && reader(gone.keyframe, gone.onto, gone.T_onto);)
    all.push_back(gone);
  // The last first: those hang on keyframes that are left.
  std::map<int, slam::NavigationGraph::Retired> hang;
  for (std::size_t i = all.size(); i-- > 0;) {
    slam::NavigationGraph::Retired& gone = all[i];
    if (const auto further = hang.find(gone.onto); further != hang.end()) {
      gone.onto = further->second.onto;
      gone.T_onto = further->second.T_onto * gone.T_onto;
    }
    hang.emplace(gone.keyframe, gone);
  }
  return hang;
}

void OnboardOutput::placeStereoPoses(const std::function<SE3(const MapOutput&)>& T_nav_cam) {
  readPairs();
  const std::map<int, slam::NavigationGraph::Retired> retired = readRetired();
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    MapOutput pair = outputs_[i];
    if (const auto gone = retired.find(pair.keyframe); gone != retired.end()) {
      pair.keyframe = gone->second.onto;
      pair.T_odom_cam = gone->second.T_onto * pair.T_odom_cam;
    }
    poses_.poses[i].T_nav_cam = T_nav_cam(pair);
  }
}

void OnboardOutput::writeClosures(const LocalisationCore& localisation) {
  // A keyframe is the first pair that hung on it.
  std::vector<const io::StereoPose*> pair(static_cast<std::size_t>(localisation.keyframes()));
  for (std::size_t i = outputs_.size(); i-- > 0;)
    if (outputs_[i].keyframe >= 0) pair[static_cast<std::size_t>(outputs_[i].keyframe)] = &poses_.poses[i];
  AtomicFile file(folder_.path() / "closures.csv");
  file.stream() << "left_a,left_b,x_m,y_m,z_m,qw,qx,qy,qz,sigma_position_m,sigma_rotation_rad,inliers,chi2,"
                   "confirmed\n";
  std::array<char, 400> line{};
  for (const Closure& c : localisation.closures().closures()) {
    const io::StereoPose *a = pair[static_cast<std::size_t>(c.a)], *b = pair[static_cast<std::size_t>(c.b)];
    if (a == nullptr || b == nullptr) continue;
    const SE3 now = a->T_nav_cam.inverse() * b->T_nav_cam;
    const Vector6d off = (c.T_a_b.inverse() * now).log();
    const Eigen::Vector3d& t = c.T_a_b.translation();
    const Eigen::Quaterniond& q = c.T_a_b.rotation();
    std::snprintf(line.data(), line.size(), "%s,%s,%.5f,%.5f,%.5f,%.8f,%.8f,%.8f,%.8f,%.5f,%.6f,%d,%.3f,%d\n",
                  a->left_image.c_str(), b->left_image.c_str(), t.x(), t.y(), t.z(), q.w(), q.x(), q.y(),
                  q.z(), std::sqrt(c.covariance.topLeftCorner<3, 3>().trace() / 3),
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
  if (!downlink_.stream.is_open()) open(downlink_);
  if (!telemetry::writePacket(downlink_.stream, utc_ns, frame))
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
  writeFile(folder_.path() / name, text);
}

void OnboardOutput::commit() {
  if (outputs_.empty()) readPairs();
  io::writeStereoPoses(folder_.path() / "stereo_pose_est.data", poses_);
  for (Growing& file : files_) {
    if (!file.stream.is_open()) continue;
    file.stream.close();
    if (file.stream.fail())
      throw std::runtime_error("cannot write into " + folder_.path().string() + " (disk full?)");
  }
  giveRoomBack();
  for (const std::size_t passing : {1U, 5U}) std::filesystem::remove(folder_.path() / files_[passing].name);
  folder_.commit();
}

template <typename Archive>
void OnboardOutput::exchange(Archive& archive) {
  for (Growing& file : files_) {
    bool there = file.stream.is_open();
    std::uint64_t bytes = there ? static_cast<std::uint64_t>(file.stream.tellp()) : 0;
    archive(there, bytes);
    archive.require(there || !file.from_the_start, "a file that must be there is not");
    if constexpr (Archive::kLoading) {
      std::error_code error;
      const std::uint64_t now = std::filesystem::file_size(folder_.path() / file.name, error);
      archive.require(!there || (!error && now >= bytes), "the output's files are shorter than they were");
      if (archive.ok()) cutBack(file, there, bytes);
    }
  }
  archive(health_header_);
}

void OnboardOutput::cutBack(Growing& file, bool there, std::uint64_t bytes) {
  const std::filesystem::path path = folder_.path() / file.name;
  if (file.stream.is_open()) file.stream.close();
  if (!there) {
    std::filesystem::remove(path);
    return;
  }
  std::filesystem::resize_file(path, bytes);
  open(file);
}

void OnboardOutput::save(rt::StateWriter& writer) {
  for (Growing& file : files_)
    if (file.stream.is_open()) file.stream.flush();
  writer.section(kTag, kVersion, [&] { exchange(writer); });
}

bool OnboardOutput::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { exchange(reader); });
}

std::vector<std::filesystem::path> OnboardOutput::files() const {
  std::vector<std::filesystem::path> paths;
  for (const Growing& file : files_) paths.push_back(folder_.path() / file.name);
  return paths;
}

}  // namespace fathom::onboard
