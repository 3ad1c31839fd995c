#include "realtime/onboard/onboard_output.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iomanip>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "recon/geometry/state_values.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::onboard {

namespace {

// What onboard/ of a mission folder may hold.
constexpr std::array<std::string_view, 10> kOurs = {
    "packets.bin",  "downlink.bin",         "closures.csv", "health.csv",  "map.ply",
    "odometry.csv", "stereo_pose_est.data", "report.json",  "timing.json", "live.json"};

constexpr std::uint32_t kTag = rt::stateTag("OUTP"), kVersion = 3;
constexpr std::size_t kPairBytes = 512;  // of a pair's record, at most, without its names

// Written to try the disk; never part of the folder.
constexpr const char* kProbe = "probe.tmp";

OutputFolder::Life durable(OutputFolder::Life life) {
  life.durable = true;
  return life;
}

std::uint64_t roomFor(double hours, double bytes_an_hour) {
  return hours > 0 ? static_cast<std::uint64_t>(hours * bytes_an_hour) : 0;
}

// A pair's record, for the time when its pose is known.
template <typename Archive, typename Output, typename Name, typename Altitude>
void exchangePair(Archive& archive, Output& output, Name& left, Name& right, Altitude& altitude) {
  MapOutput::exchange(archive, output);
  archive(left, right, altitude);
}

}  // namespace

OnboardOutput::OnboardOutput(const std::filesystem::path& folder, const Geodetic& origin,
                             const OutputFolder::Life& life, double planned_hours)
    : folder_(folder, kOurs, durable(life)),
      odometry_(folder_.path() / "odometry.csv", roomFor(planned_hours, 5e6)),
      pairs_(folder_.path() / "pairs.tmp", roomFor(planned_hours, 5e6)),
      packets_(folder_.path() / "packets.bin", roomFor(planned_hours, 3e6)),
      downlink_(folder_.path() / "downlink.bin", roomFor(planned_hours, 1e6)),
      health_(folder_.path() / "health.csv", roomFor(planned_hours, 8e6)),
      retired_(folder_.path() / "retired.tmp", roomFor(planned_hours, 6e5)) {
  constexpr int kDigits = 15;  // a counter of 1e15 still prints whole
  row_.precision(kDigits);
  poses_.origin = origin;
  for (GrowingFile* file : files_)
    if (file != &downlink_) file->open();
  if (odometry_.size() > 0) return;
  io::writeTrajectoryHead(row_.begin());
  odometry_.add(row_.row());
}

// The disk's refusals wait for commit().
void OnboardOutput::attempt(const std::string& name, const std::function<void()>& write) {
  try {
    write();
  } catch (const std::runtime_error& e) {
    if (failed_.empty()) failed_ = name + ": " + e.what();
  }
}

void OnboardOutput::addOdometry(std::int64_t utc_ns, const SE3& T_odom_body) {
  const bool finite = T_odom_body.translation().allFinite() && T_odom_body.rotation().coeffs().allFinite();
  if (!finite) return;
  io::writeTrajectoryPoint(row_.begin(), {utc_ns, T_odom_body});
  odometry_.add(row_.row());
}

void OnboardOutput::addStereoPose(const MapOutput& output, const std::string& left, const std::string& right,
                                  double altitude) {
  std::uint32_t bytes = 0;
  record_.resize(sizeof bytes + kPairBytes + left.size() + right.size());
  rt::StateWriter writer({record_.data() + sizeof bytes, record_.size() - sizeof bytes});
  exchangePair(writer, output, left, right, altitude);
  assert(!writer.full());
  bytes = static_cast<std::uint32_t>(writer.size());
  std::memcpy(record_.data(), &bytes, sizeof bytes);
  pairs_.add({record_.data(), sizeof bytes + bytes});
}

void OnboardOutput::readPairs() {
  poses_.poses.clear();
  outputs_.clear();
  const std::vector<std::uint8_t> all = pairs_.read();
  std::uint32_t bytes = 0;
  for (std::size_t at = 0; at < all.size(); at += bytes) {
    if (all.size() - at >= sizeof bytes) std::memcpy(&bytes, all.data() + at, sizeof bytes);
    at = std::min(all.size(), at + sizeof bytes);
    rt::StateReader reader({all.data() + at, std::min<std::size_t>(bytes, all.size() - at)});
    MapOutput output;
    io::StereoPose pose;
    exchangePair(reader, output, pose.left_image, pose.right_image, pose.altitude);
    if (!reader.ok()) {
      rows_damaged_ = true;
      if (failed_.empty()) failed_ = std::string("pairs.tmp: ") + reader.failure();
      return;
    }
    pose.id = static_cast<int>(output.pair_index);
    pose.utc_s = static_cast<double>(output.utc_ns) / kNanosecondsPerSecond;
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
  retired_.add(writer.written());
}

std::map<int, slam::NavigationGraph::Retired> OnboardOutput::readRetired() {
  const std::vector<std::uint8_t> bytes = retired_.read();
  rt::StateReader reader(bytes);
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
  attempt("closures.csv", [&] { writeClosuresFile(localisation); });
}

void OnboardOutput::writeClosuresFile(const LocalisationCore& localisation) {
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
  if (telemetry::writePacket(row_.begin(), utc_ns, frame)) packets_.add(row_.row());
}

void OnboardOutput::addDownlink(std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
  if (telemetry::writePacket(row_.begin(), utc_ns, frame)) downlink_.add(row_.row());
}

void OnboardOutput::addHealth(std::int64_t utc_ns, const std::vector<std::pair<std::string, double>>& row) {
  row_.begin();
  if (!health_header_) {
    row_ << "utc_ns";
    for (const auto& [name, value] : row) row_ << ',' << name;
    row_ << '\n';
    health_header_ = true;
  }
  row_ << utc_ns;
  for (const auto& [name, value] : row) row_ << ',' << value;
  row_ << '\n';
  health_.add(row_.row());
}

void OnboardOutput::writeMap(const Mesh& map_in_nav) {
  attempt("map.ply", [&] {
    writePly(folder_.path() / "map.ply", map_in_nav, {"frame nav: x north, y east, z down [m]"});
  });
}

void OnboardOutput::writeText(const std::string& name, const std::string& text) {
  attempt(name, [&] { writeFile(folder_.path() / name, text); });
}

bool OnboardOutput::lost() const {
  return std::any_of(files_.begin(), files_.end(), [](const GrowingFile* f) { return f->lostRows() > 0; });
}

std::string OnboardOutput::failure() const {
  for (const GrowingFile* file : files_)
    if (std::string why = file->failure(); !why.empty()) return why;
  return failed_;
}

bool OnboardOutput::diskTakesData() {
  bool waited = false, taken = true;
  for (GrowingFile* file : files_) {
    if (file->waiting() == 0) continue;
    (void)file->flush();
    waited = true;
    taken = taken && file->waiting() == 0;
  }
  return waited ? taken : probe();
}

bool OnboardOutput::probe() const {
  constexpr int kMode = 0644;
  const std::array<std::uint8_t, 4096> nothing{};  // a block of the disk
  const std::filesystem::path path = folder_.path() / kProbe;
  const Descriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kMode));
  const bool taken =
      file.open() && writeAt(file.get(), nothing, 0) == nothing.size() && ::fdatasync(file.get()) == 0;
  ::unlink(path.c_str());
  return taken;
}

void OnboardOutput::commit() {
  if (outputs_.empty()) readPairs();
  attempt("stereo_pose_est.data",
          [&] { io::writeStereoPoses(folder_.path() / "stereo_pose_est.data", poses_); });
  for (GrowingFile* file : files_) (void)file->finish();
  if (const std::string why = failure(); !why.empty())
    throw std::runtime_error("cannot write into " + folder_.path().string() + ": " + why);
  for (const std::filesystem::path& passing : {pairs_.path(), retired_.path(), folder_.path() / kProbe})
    std::filesystem::remove(passing);
  folder_.commit();
}

template <typename Archive>
void OnboardOutput::exchange(Archive& archive) {
  for (GrowingFile* file : files_) {
    bool begun = file->begun();
    std::uint64_t bytes = file->size(), lost_rows = file->lostRows();
    archive(begun, bytes, lost_rows);
    archive.require(begun || file == &downlink_, "a file that must be there is not");
    if constexpr (Archive::kLoading) {
      if (!archive.ok()) return;
      archive.require(file->cutBack(begun, bytes, lost_rows),
                      "the output's files are shorter than they were");
    }
  }
  archive(health_header_);
}

bool OnboardOutput::readyToSave() {
  bool written = failed_.empty();
  for (GrowingFile* file : files_) written = file->flush() && written;
  return written;
}

void OnboardOutput::save(rt::StateWriter& writer) {
  for (GrowingFile* file : files_) (void)file->flush();
  writer.section(kTag, kVersion, [&] { exchange(writer); });
}

bool OnboardOutput::load(rt::StateReader& reader) {
  failed_.clear();
  return reader.section(kTag, kVersion, [&] { exchange(reader); });
}

std::vector<std::filesystem::path> OnboardOutput::files() const {
  std::vector<std::filesystem::path> paths;
  for (const GrowingFile* file : files_) paths.push_back(file->path());
  return paths;
}

}  // namespace fathom::onboard
