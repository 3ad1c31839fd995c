#include "recon/topside/input/mission_input.hpp"

#include <algorithm>
#include <set>

#include "firmware_if/feature_file.hpp"
#include "firmware_if/image_file.hpp"
#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {
namespace fs = std::filesystem;
namespace {

constexpr int kProbed = 8;  // images whose samples tell a foreign folder's bits

// Names of a folder's images, sorted; `most`: no more than so many are wanted.
std::vector<std::string> imagesIn(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    std::string name = entry.path().filename().string();
    if (io::parseImageFileName(name)) names.push_back(std::move(name));
  }
  std::sort(names.begin(), names.end());
  return names;
}

// img/, else the folder itself, else the one folder in it that holds images.
fs::path imageFolder(const fs::path& root) {
  if (fs::is_directory(root / "img")) return {};
  if (!imagesIn(root).empty()) return root;
  std::set<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root, error))
    if (entry.is_directory() && !imagesIn(entry.path()).empty()) found.insert(entry.path());
  if (found.size() == 1) return *found.begin();
  throw InputError(root.string(), "img",
                   found.empty() ? "no images (PR_YYYYMMDD_HHMMSS_mmm_LC16.tif) here or one folder below"
                                 : "images in several folders; give one of them, or link them into img/");
}

fs::path calibIn(const fs::path& root) {
  if (fs::exists(root / "stereo.calib")) return {};
  std::set<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root, error))
    if (entry.path().extension() == ".calib") found.insert(entry.path());
  if (found.size() == 1) return *found.begin();
  throw InputError(root.string(), "stereo.calib",
                   found.empty() ? "no stereo calibration; give one with --calib"
                                 : "several calibrations; name one with --calib");
}

int probeBits(const fs::path& images, const std::vector<std::string>& names) {
  int bits = 8;
  const std::size_t step = std::max<std::size_t>(1, names.size() / kProbed);
  for (std::size_t k = 0; k < names.size(); k += step) {
    try {
      bits = std::max(bits, io::readAnyImage(images / names[k]).view.bits);
    } catch (const InputError&) {  // counted where it is used
    }
  }
  return bits;
}

void assumeMission(MissionInput& in) {
  const auto note = [&](std::string line) { in.assumed.push_back(std::move(line)); };
  io::MissionConfig& m = in.mission;
  m.vehicle_name = in.paths.root.filename().string();
  if (m.vehicle_name.empty()) m.vehicle_name = "unknown";
  note("no mission.toml: the vehicle is named after the folder");
  m.cameras.bits = probeBits(in.paths.images(), imagesIn(in.paths.images()));
  note("left images are Bayer RGGB, right images mono, of " + std::to_string(m.cameras.bits) +
       " bits, as the brightest of some samples tells");
  if (in.given_poses) {
    m.origin = in.given_poses->origin;
  } else {
    // Looking down, top of the image forward: x of the camera to starboard, y aft.
    Eigen::Matrix3d down;
    down << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    m.T_body_cam = SE3(down, Eigen::Vector3d::Zero());
    note("the cameras look straight down, top of the image forward, at the vehicle's reference point");
    note("nav's origin is 0 N 0 E");
  }
  note("declination and time offsets are 0");
}

void digestFile(Hasher& hasher, const fs::path& path) {
  hasher.add(path.filename().string());
  if (fs::exists(path)) hasher.add(digestOfFile(path));
}

void addIdentity(Hasher& hasher, const fs::path& path, bool verify) {
  std::error_code error;
  const auto size = fs::file_size(path, error);
  hasher.add(path.filename().string(), static_cast<std::uint64_t>(error ? 0 : size), error ? 1 : 0);
  if (error) return;
  if (verify)
    hasher.add(digestOfFile(path));
  else
    hasher.add(static_cast<std::int64_t>(fs::last_write_time(path, error).time_since_epoch().count()));
}

}  // namespace

Digest MissionInput::imageIdentity(const std::string& left, const std::string& right) const {
  Hasher hasher;
  if (features_only) {
    addIdentity(hasher, paths.features() / io::featureFileName(left), verify);
  } else {
    addIdentity(hasher, paths.images() / left, verify);
    addIdentity(hasher, paths.images() / right, verify);
  }
  return hasher.finish();
}

void addPose(Hasher& hasher, const SE3& pose) {
  const Eigen::Vector4d& q = pose.rotation().coeffs();
  const Eigen::Vector3d& t = pose.translation();
  hasher.add(q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z());
}

void addRig(Hasher& hasher, const MissionInput& input) {
  for (const Camera* c : {&input.rig.left, &input.rig.right})
    hasher.add(c->width, c->height, c->fx, c->fy, c->cx, c->cy, c->k1, c->k2, c->p1, c->p2, c->k3);
  addPose(hasher, input.rig.T_right_left);
  const io::MissionConfig& m = input.mission;
  addPose(hasher, m.T_body_cam);
  addPose(hasher, m.T_body_dvl);
  hasher.add(m.cameras.left_format, m.cameras.right_format, m.cameras.bits, input.features_only);
}

MissionInput openMission(const fs::path& folder, const InputOptions& options) {
  MissionInput in;
  in.paths = io::MissionPaths(folder);
  in.verify = options.verify;
  const bool described = fs::exists(folder / "mission.toml");
  const fs::path own_poses = folder / "stereo_pose_est.data";
  fs::path poses = options.poses;
  if (poses.empty() && !described && fs::exists(own_poses)) poses = own_poses;
  if (!poses.empty()) in.given_poses = io::readStereoPoses(poses);
  // A log of this project's without its mission.toml is a damaged mission, and nothing to guess about; and
  // without poses and RAW.auv the mission.toml is what is missing.
  const bool foreign = !fs::exists(in.paths.log()) && (!poses.empty() || in.paths.rawAuv());
  if (described || !foreign) in.mission = io::readMissionConfig(folder);
  in.features_only = io::isFeatureMission(in.paths);
  if (!in.features_only && !described) in.paths.images_elsewhere = imageFolder(folder);
  in.paths.calib_elsewhere = options.calib.empty() && !described ? calibIn(folder) : options.calib;
  in.rig = readStereoCalib(in.paths.calib());
  if (!described) assumeMission(in);

  Hasher hasher;
  digestFile(hasher, folder / "mission.toml");
  digestFile(hasher, in.paths.calib());
  if (in.given_poses) {
    digestFile(hasher, poses);
  } else if (fs::exists(in.paths.log())) {
    digestFile(hasher, in.paths.log());
  } else if (const auto raw = in.paths.rawAuv()) {
    digestFile(hasher, *raw);
  }
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry :
       fs::directory_iterator(in.features_only ? in.paths.features() : in.paths.images(), error))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  for (const std::string& name : names) hasher.add(name);
  in.identity = hasher.finish();
  return in;
}

}  // namespace fathom::topside
