#include "firmware_if/mission/pose_files.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

constexpr std::size_t kMaxPoseFileBytes = std::size_t{1} << 30;
constexpr double kMaxAngle = 6.3;     // [rad], a turn in either direction
constexpr double kMaxDistance = 1e6;  // [m] from the origin
constexpr double kMaxUtc = 9.2e9;     // [s], the end of int64 nanoseconds

// The lines of a text file, with their numbers for the errors.
class PoseFileLines {
 public:
  PoseFileLines(std::filesystem::path path, const char* what) : path_(std::move(path)) {
    const std::vector<std::uint8_t> bytes = readFileBytes(path_, kMaxPoseFileBytes, what);
    text_.assign(bytes.begin(), bytes.end());
  }
  // The next line without its end; false behind the last. A last line without an end was cut: it is refused.
  bool next(std::string_view& line) {
    if (at_ >= text_.size()) return false;
    ++number_;
    const std::size_t end = text_.find('\n', at_);
    if (end == std::string::npos) fail("has no end: the file was cut; write it again");
    line = std::string_view(text_).substr(at_, end - at_);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    at_ = end + 1;
    return true;
  }
  [[noreturn]] void fail(const std::string& fix) const {
    throw InputError(path_, "line " + std::to_string(number_), fix);
  }
  [[noreturn]] void failWhole(const std::string& fix) const { throw InputError(path_, "", fix); }

 private:
  std::filesystem::path path_;
  std::string text_;
  std::size_t at_ = 0, number_ = 0;
};

// The fields of one line, taken in order.
class PoseFields {
 public:
  PoseFields(const PoseFileLines& lines, std::string_view line, std::string_view separators) : lines_(lines) {
    const bool one_each = separators == ",";
    for (std::size_t at = 0; at <= line.size();) {
      const std::size_t end = std::min(line.find_first_of(separators, at), line.size());
      if (one_each || end > at) words_.push_back(line.substr(at, end - at));
      at = end + 1;
    }
  }
  [[nodiscard]] std::size_t count() const { return words_.size(); }
  std::string_view text() { return words_[index_++]; }

  double number(const char* name, double min, double max) {
    std::string_view word = text();
    const std::string shown(word.substr(0, 40));
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    double value = 0;
    const auto result = std::from_chars(word.data(), word.data() + word.size(), value);
    if (result.ec != std::errc() || result.ptr != word.data() + word.size() ||
        !(value >= min && value <= max))
      fail(name, shown, "a number from " + std::to_string(min) + " to " + std::to_string(max));
    return value;
  }
  template <class Integer>
  Integer integer(const char* name, Integer min, Integer max) {
    const std::string_view word = text();
    Integer value = 0;
    const auto result = std::from_chars(word.data(), word.data() + word.size(), value);
    if (result.ec != std::errc() || result.ptr != word.data() + word.size() || value < min || value > max)
      fail(name, std::string(word.substr(0, 40)),
           "a whole number from " + std::to_string(min) + " to " + std::to_string(max));
    return value;
  }

 private:
  [[noreturn]] void fail(const char* name, const std::string& word, const std::string& wanted) const {
    lines_.fail("field " + std::to_string(index_) + " (" + name + ") is '" + word + "'; give " + wanted);
  }
  const PoseFileLines& lines_;
  std::vector<std::string_view> words_;
  std::size_t index_ = 0;
};

// The shortest decimal that reads back to the same bits.
class ShortestDecimal {
 public:
  explicit ShortestDecimal(double value) {
    if (!std::isfinite(value))
      throw std::runtime_error("a number that is not finite cannot be written to a pose file");
    end_ = std::to_chars(text_.data(), text_.data() + text_.size(), value + 0.0).ptr;
  }
  friend std::ostream& operator<<(std::ostream& out, const ShortestDecimal& number) {
    return out.write(number.text_.data(), number.end_ - number.text_.data());
  }

 private:
  std::array<char, 40> text_;
  char* end_;
};

// What the two ACFR pose files share: version line, comments, origin, and fields 1 to 10.
struct PoseLine {
  int id = 0;
  double utc_s = 0;
  SE3 pose;
};

constexpr std::size_t kSharedFields = 10;

PoseLine readShared(PoseFields& fields) {
  PoseLine line;
  line.id = fields.integer<int>("pose id", 0, std::numeric_limits<int>::max());
  line.utc_s = fields.number("time", -kMaxUtc, kMaxUtc);
  static_cast<void>(fields.number("latitude", -90, 90));
  static_cast<void>(fields.number("longitude", -360, 360));
  const double x = fields.number("X", -kMaxDistance, kMaxDistance);
  const double y = fields.number("Y", -kMaxDistance, kMaxDistance);
  const double z = fields.number("Z", -kMaxDistance, kMaxDistance);
  const double roll = fields.number("angle about X", -kMaxAngle, kMaxAngle);
  const double pitch = fields.number("angle about Y", -kMaxAngle, kMaxAngle);
  const double yaw = fields.number("angle about Z", -kMaxAngle, kMaxAngle);
  line.pose = SE3::fromEuler(roll, pitch, yaw, {x, y, z});
  return line;
}

void writeShared(std::ostream& out, int id, double utc_s, const SE3& pose,
                 const LocalTransverseMercator& projection) {
  const Eigen::Vector3d& t = pose.translation();
  const Geodetic position = projection.toGeodetic({t.x(), t.y()});
  const Eigen::Vector3d euler = pose.euler();
  out << id << '\t' << ShortestDecimal(utc_s) << '\t'
      << ShortestDecimal(position.latitude * kDegreesPerRadian) << '\t'
      << ShortestDecimal(position.longitude * kDegreesPerRadian);
  for (const double value : {t.x(), t.y(), t.z(), euler.x(), euler.y(), euler.z()})
    out << '\t' << ShortestDecimal(value);
}

// Reads the head of the file named `kind` in the given version and calls `pose` with the fields of each pose
// line.
template <class Pose>
Geodetic readPoseFile(PoseFileLines& lines, const std::string& kind, int version, std::size_t field_count,
                      Pose pose) {
  const std::string magic = "% " + kind + " VERSION ";
  std::string_view line;
  if (!lines.next(line)) lines.failWhole("is empty");
  if (line.substr(0, magic.size()) != magic) lines.fail("is not '" + magic + std::to_string(version) + "'");
  std::string_view found = line.substr(magic.size());
  while (!found.empty() && found.back() == ' ') found.remove_suffix(1);
  if (found == "1")
    lines.fail("is version 1, which has no latitude and longitude; convert it to version " +
               std::to_string(version));
  if (found != std::to_string(version))
    lines.fail("is version " + std::string(found.substr(0, 10)) + "; version " + std::to_string(version) +
               " is read");
  Geodetic origin;
  bool has_latitude = false, has_longitude = false;
  while (lines.next(line)) {
    PoseFields fields(lines, line, " \t");
    if (fields.count() == 0 || line.front() == '%') continue;
    if (line.substr(0, 7) == "ORIGIN_") {
      if (fields.count() != 2)
        lines.fail("has " + std::to_string(fields.count()) + " fields; ORIGIN_... takes one");
      const std::string_view key = fields.text();
      if (key == "ORIGIN_LATITUDE") {
        origin.latitude =
            fields.number("latitude", -kMaxOriginLatitude_deg, kMaxOriginLatitude_deg) / kDegreesPerRadian;
        has_latitude = true;
      } else if (key == "ORIGIN_LONGITUDE") {
        origin.longitude = fields.number("longitude", -180, 180) / kDegreesPerRadian;
        has_longitude = true;
      } else {
        lines.fail("is unknown; ORIGIN_LATITUDE and ORIGIN_LONGITUDE are read");
      }
      continue;
    }
    if (!has_latitude || !has_longitude) lines.fail("comes before ORIGIN_LATITUDE and ORIGIN_LONGITUDE");
    if (fields.count() != field_count)
      lines.fail("has " + std::to_string(fields.count()) + " fields; a pose has " +
                 std::to_string(field_count));
    pose(fields);
  }
  if (!has_latitude || !has_longitude) lines.failWhole("has no ORIGIN_LATITUDE or no ORIGIN_LONGITUDE");
  return origin;
}

void writeHead(std::ostream& out, const std::string& kind, int version, const char* columns,
               const Geodetic& origin) {
  out << "% " << kind << " VERSION " << version << "\n% " << columns << "\nORIGIN_LATITUDE "
      << ShortestDecimal(origin.latitude * kDegreesPerRadian) << "\nORIGIN_LONGITUDE "
      << ShortestDecimal(origin.longitude * kDegreesPerRadian) << '\n';
}

constexpr const char* kTrajectoryHeader = "utc_ns,north_m,east_m,depth_m,qw,qx,qy,qz";
constexpr const char* kSharedColumns =
    "pose id, time [s], latitude [deg], longitude [deg], X north [m], Y east [m], Z depth [m], angles about "
    "X, Y, Z [rad], ";

// Characters of a name that would end its field, and their codes.
constexpr std::pair<char, std::string_view> kCodes[] = {
    {' ', "%20"}, {'\t', "%09"}, {'\r', "%0D"}, {'\n', "%0A"}, {'%', "%25"}};

std::string withoutBlanks(const std::string& name) {
  std::string out;
  for (const char c : name) {
    const auto* code =
        std::find_if(std::begin(kCodes), std::end(kCodes), [&](auto& k) { return k.first == c; });
    if (code == std::end(kCodes))
      out += c;
    else
      out += code->second;
  }
  return out;
}

std::string withBlanks(std::string_view field) {
  std::string out;
  while (!field.empty()) {
    const auto* code = std::find_if(std::begin(kCodes), std::end(kCodes),
                                    [&](auto& k) { return field.starts_with(k.second); });
    out += code == std::end(kCodes) ? field.front() : code->first;
    field.remove_prefix(code == std::end(kCodes) ? 1 : code->second.size());
  }
  return out;
}

std::string covarianceHeader() {
  constexpr std::array<const char*, 6> kOf = {"north",       "east",       "down",
                                              "about_north", "about_east", "about_down"};
  std::string header = "left_image";
  for (std::size_t i = 0; i < kOf.size(); ++i)
    for (std::size_t j = i; j < kOf.size(); ++j) header += std::string(",") + kOf[i] + "_" + kOf[j];
  return header;
}

}  // namespace

StereoPoseFile readStereoPoses(const std::filesystem::path& path) {
  PoseFileLines lines(path, "a stereo_pose_est.data");
  StereoPoseFile file;
  file.origin = readPoseFile(lines, "STEREO_POSE_FILE", 2, kSharedFields + 5, [&](PoseFields& fields) {
    const PoseLine shared = readShared(fields);
    StereoPose pose{shared.id, shared.utc_s, shared.pose, "", "", 0, 0, false};
    pose.left_image = withBlanks(fields.text());
    pose.right_image = withBlanks(fields.text());
    for (const std::string& image : {pose.left_image, pose.right_image})
      if (!nameInside(image))
        lines.fail("has an image '" + image.substr(0, 40) + "'; give the name of a file in img/");
    pose.altitude = fields.number("altitude", 0, kMaxDistance);
    pose.footprint_radius = fields.number("bounding radius", 0, kMaxDistance);
    pose.likely_crossover = fields.integer<int>("likely crossover", 0, 1) == 1;
    file.poses.push_back(std::move(pose));
  });
  return file;
}

void writeStereoPoses(const std::filesystem::path& path, const StereoPoseFile& file) {
  const LocalTransverseMercator projection(file.origin);
  AtomicFile atomic(path);
  std::ostream& out = atomic.stream();
  const std::string columns = std::string(kSharedColumns) +
                              "left image, right image, altitude [m], bounding radius [m], likely crossover";
  writeHead(out, "STEREO_POSE_FILE", 2, columns.c_str(), file.origin);
  for (const StereoPose& pose : file.poses) {
    for (const std::string& image : {pose.left_image, pose.right_image})
      if (!nameInside(image))
        throw std::invalid_argument("image name '" + image + "' does not fit a pose file");
    writeShared(out, pose.id, pose.utc_s, pose.T_nav_cam, projection);
    out << '\t' << withoutBlanks(pose.left_image) << '\t' << withoutBlanks(pose.right_image) << '\t'
        << ShortestDecimal(pose.altitude) << '\t' << ShortestDecimal(pose.footprint_radius) << '\t'
        << (pose.likely_crossover ? 1 : 0) << '\n';
  }
  atomic.commit();
}

VehiclePoseFile readVehiclePoses(const std::filesystem::path& path) {
  PoseFileLines lines(path, "a vehicle_pose_est.data");
  VehiclePoseFile file;
  file.origin = readPoseFile(lines, "VEHICLE_POSE_FILE", 3, kSharedFields + 1, [&](PoseFields& fields) {
    const PoseLine shared = readShared(fields);
    file.poses.push_back({shared.id, shared.utc_s, shared.pose, fields.number("altitude", 0, kMaxDistance)});
  });
  return file;
}

void writeVehiclePoses(const std::filesystem::path& path, const VehiclePoseFile& file) {
  const LocalTransverseMercator projection(file.origin);
  AtomicFile atomic(path);
  std::ostream& out = atomic.stream();
  writeHead(out, "VEHICLE_POSE_FILE", 3, (std::string(kSharedColumns) + "altitude [m]").c_str(), file.origin);
  for (const VehiclePose& pose : file.poses) {
    writeShared(out, pose.id, pose.utc_s, pose.T_nav_body, projection);
    out << '\t' << ShortestDecimal(pose.altitude) << '\n';
  }
  atomic.commit();
}

std::vector<PoseCovariance> readPoseCovariances(const std::filesystem::path& path) {
  PoseFileLines lines(path, "a pose_covariances.csv");
  std::string_view line;
  if (!lines.next(line) || line != covarianceHeader()) lines.fail("is not '" + covarianceHeader() + "'");
  std::vector<PoseCovariance> poses;
  while (lines.next(line)) {
    PoseFields fields(lines, line, ",");
    if (fields.count() != 22)
      lines.fail("has " + std::to_string(fields.count()) + " fields; a covariance has 22");
    PoseCovariance pose;
    pose.left_image = fields.text();
    for (int i = 0; i < 6; ++i)
      for (int j = i; j < 6; ++j)
        pose.covariance(i, j) = pose.covariance(j, i) =
            fields.number("covariance", -kMaxDistance * kMaxDistance, kMaxDistance * kMaxDistance);
    poses.push_back(pose);
  }
  return poses;
}

void writePoseCovariances(const std::filesystem::path& path, const std::vector<PoseCovariance>& poses) {
  AtomicFile file(path);
  file.stream() << covarianceHeader() << '\n';
  for (const PoseCovariance& pose : poses) {
    file.stream() << tableField(pose.left_image);
    for (int i = 0; i < 6; ++i)
      for (int j = i; j < 6; ++j) file.stream() << ',' << ShortestDecimal(pose.covariance(i, j));
    file.stream() << '\n';
  }
  file.commit();
}

std::vector<TrajectoryPoint> readTrajectory(const std::filesystem::path& path) {
  PoseFileLines lines(path, "a trajectory.csv");
  std::string_view line;
  if (!lines.next(line) || line != kTrajectoryHeader)
    lines.fail(std::string("is not '") + kTrajectoryHeader + "'");
  std::vector<TrajectoryPoint> points;
  while (lines.next(line)) {
    PoseFields fields(lines, line, ",");
    if (fields.count() != 8) lines.fail("has " + std::to_string(fields.count()) + " fields; a point has 8");
    TrajectoryPoint point;
    point.utc_ns = fields.integer<std::int64_t>("utc_ns", std::numeric_limits<std::int64_t>::min(),
                                                std::numeric_limits<std::int64_t>::max());
    if (!points.empty() && point.utc_ns <= points.back().utc_ns)
      lines.fail("is not later than the line before");
    Eigen::Vector3d translation;
    for (double& value : translation) value = fields.number("position", -kMaxDistance, kMaxDistance);
    const double w = fields.number("qw", -1.1, 1.1), x = fields.number("qx", -1.1, 1.1);
    const double y = fields.number("qy", -1.1, 1.1), z = fields.number("qz", -1.1, 1.1);
    const Eigen::Quaterniond rotation(w, x, y, z);
    constexpr double kNormTolerance = 1e-3;  // other writers round to a few decimals
    if (std::abs(rotation.norm() - 1.0) > kNormTolerance)
      lines.fail("has a quaternion that is not of length 1");
    point.pose = SE3(rotation, translation);
    points.push_back(point);
  }
  return points;
}

void writeTrajectoryHead(std::ostream& out) {
  out << kTrajectoryHeader << '\n';
}

void writeTrajectoryPoint(std::ostream& out, const TrajectoryPoint& point) {
  const Eigen::Vector3d& t = point.pose.translation();
  const Eigen::Quaterniond& q = point.pose.rotation();
  out << point.utc_ns;
  for (const double value : {t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z()})
    out << ',' << ShortestDecimal(value);
  out << '\n';
}

void writeTrajectory(const std::filesystem::path& path, const std::vector<TrajectoryPoint>& points) {
  AtomicFile file(path);
  writeTrajectoryHead(file.stream());
  for (const TrajectoryPoint& point : points) writeTrajectoryPoint(file.stream(), point);
  file.commit();
}

}  // namespace fathom::io
