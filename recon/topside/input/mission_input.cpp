#include "recon/topside/input/mission_input.hpp"

#include <algorithm>
#include <cstdio>
#include <set>
#include <variant>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/import/calibration/calibration.hpp"
#include "recon/import/images/image_samples.hpp"

namespace fathom::topside {
namespace fs = std::filesystem;
namespace {

// img/, the folder itself, or the one folder in it, whichever holds the image.
fs::path folderHolding(const fs::path& root, const std::string& image) {
  if (fs::exists(root / "img" / image)) return root / "img";
  if (fs::exists(root / image)) return root;
  std::set<fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root, error))
    if (entry.is_directory() && fs::exists(entry.path() / image)) found.insert(entry.path());
  if (found.size() == 1) return *found.begin();
  throw InputError(root.string(), image,
                   found.empty() ? "is neither here nor one folder below"
                                 : "is in several folders; give one of them, or link them into img/");
}

std::string about(PixelFormat format) {
  return format == PixelFormat::kRgb ? "RGB" : format == PixelFormat::kMono ? "grey" : "a Bayer mosaic RGGB";
}

// The images that the log of an ACFR vehicle names, if it names any.
std::vector<std::array<std::string, 2>> namedByLog(const io::MissionPaths& paths) {
  std::array<std::vector<std::string>, 2> sides;
  if (!paths.rawAuv()) return {};
  io::SensorLogReader reader(paths.root);
  while (const auto entry = reader.next())
    if (const auto* event = std::get_if<ImageEvent>(&entry->sample))
      sides[event->side == CameraSide::kLeft ? 0 : 1].push_back(event->file_name);
  std::vector<std::array<std::string, 2>> pairs;
  for (std::size_t k = 0; k < std::min(sides[0].size(), sides[1].size()); ++k)
    pairs.push_back({sides[0][k], sides[1][k]});
  return pairs;
}

// Origin of nav near the log's first GPS or USBL fix, rounded to 0.01 degrees; none without fixes.
std::optional<Geodetic> firstFix(const io::MissionPaths& paths) {
  io::SensorLogReader reader(paths.root);
  while (const auto entry = reader.next()) {
    if (const auto* gps = std::get_if<GpsFix>(&entry->sample))
      return originNear({gps->latitude, gps->longitude});
    if (const auto* usbl = std::get_if<UsblFix>(&entry->sample))
      return originNear({usbl->latitude, usbl->longitude});
  }
  return {};
}

// Deepest folder that contains the mission's folder and all images.
fs::path folderOfAll(const fs::path& mission, const std::vector<StereoFilePair>& pairs) {
  fs::path folder = asNamed(mission / "").parent_path();
  for (const StereoFilePair& pair : pairs)
    for (const fs::path& file : {pair.left, pair.right})
      while (*asNamed(file).lexically_relative(folder).begin() == "..") folder = folder.parent_path();
  return folder;
}

// Where the images are, and which belong together.
std::vector<std::array<std::string, 2>> findImages(MissionInput& in, StereoFileOptions options) {
  std::vector<std::array<std::string, 2>> pairs;
  if (in.given_poses)
    for (const io::StereoPose& pose : in.given_poses->poses)
      pairs.push_back({pose.left_image, pose.right_image});
  else
    pairs = namedByLog(in.paths);
  if (!pairs.empty()) {
    in.paths.images_elsewhere = folderHolding(in.paths.root, pairs[0][0]);
    return pairs;
  }
  const bool named =
      !options.pairs.empty() || !options.left_pattern.empty() || !options.right_pattern.empty();
  if (!named) options.images = {in.paths.root};
  in.files = findStereoFiles(options);
  in.paths.images_elsewhere = folderOfAll(in.paths.root, in.files->pairs);
  for (StereoFilePair& pair : in.files->pairs) {
    for (fs::path* file : {&pair.left, &pair.right})
      *file = asNamed(*file).lexically_proximate(in.paths.images_elsewhere);
    pairs.push_back({pair.left.generic_string(), pair.right.generic_string()});
  }
  in.assumed.insert(in.assumed.end(), in.files->assumed.begin(), in.files->assumed.end());
  return pairs;
}

// A camera at the vehicle's reference point that looks straight down, top of the image forward (x of the
// camera to starboard, y aft), turned and shifted as the option says.
SE3 mountOf(const std::vector<double>& mount) {
  Eigen::Matrix3d down;
  down << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  SE3 looks_down(down, Eigen::Vector3d::Zero());
  if (mount.empty()) return looks_down;
  if (mount.size() != 3 && mount.size() != 6)
    throw InputError("--mount", std::to_string(mount.size()) + " numbers",
                     "give roll,pitch,heading in degrees, or these and x,y,z in metres");
  const Eigen::Vector3d place =
      mount.size() == 6 ? Eigen::Vector3d(mount[3], mount[4], mount[5]) : Eigen::Vector3d::Zero();
  return SE3::fromEuler(mount[0] * kRadiansPerDegree, mount[1] * kRadiansPerDegree,
                        mount[2] * kRadiansPerDegree, place) *
         looks_down;
}

void takeNavFiles(MissionInput& in, const NavFileOptions& options) {
  if (options.files.empty()) return;
  if (in.navigated)
    throw InputError("--nav", options.files.front().string(),
                     "is beside the navigation that the folder holds; take that, or this, away");
  std::optional<std::int64_t> about;
  if (in.files && !in.files->pairs.empty()) about = in.files->pairs.front().utc_ns;
  in.nav_data = readNavFiles(options, about);
  in.assumed.insert(in.assumed.end(), in.nav_data->assumed.begin(), in.nav_data->assumed.end());
}

void assumeMission(MissionInput& in, const InputOptions& options) {
  const auto note = [&](std::string line) { in.assumed.push_back(std::move(line)); };
  io::MissionConfig& m = in.mission;
  m.vehicle_name = in.paths.root.filename().string();
  if (m.vehicle_name.empty()) m.vehicle_name = "unknown";
  note("no mission.toml: the vehicle is named after the folder");
  in.samples = {samplesNamed(options.left_format), samplesNamed(options.right_format)};
  const auto pairs = findImages(in, options.files);
  std::array<std::vector<std::string>, 2> names;
  for (const auto& pair : pairs)
    for (const std::size_t side : {0U, 1U}) names[side].push_back(pair[side]);
  const Probed left = probe(in.paths.images(), names[0], in.samples[0], "--left-format"),
               right = probe(in.paths.images(), names[1], in.samples[1], "--right-format");
  if (!in.features_only) takeSizes(in.rig, in.paths.calib(), left.size, right.size);
  m.cameras.left_format = left.format;
  m.cameras.right_format = right.format;
  m.cameras.bits = std::max(left.bits, right.bits);
  note("left images are " + about(left.format) + ", right images " + about(right.format) + ", of " +
       std::to_string(m.cameras.bits) + " bits, as some of them tell" +
       (m.cameras.bits > 8 ? "; brighter samples are cut to that" : ""));
  if (in.given_poses) {
    m.origin = in.given_poses->origin;
    in.placed = m.origin.latitude != 0 || m.origin.longitude != 0;
    return;
  }
  m.T_body_cam = mountOf(options.mount);
  takeNavFiles(in, options.nav);
  if ((in.navigated || in.nav_data) && !in.mounted)
    note(
        "the cameras look straight down, top of the image forward, at the vehicle's reference point "
        "(--mount)");
  auto origin = in.nav_data ? originOf(*in.nav_data) : in.navigated ? firstFix(in.paths) : std::nullopt;
  if (const auto first = in.control ? in.control->firstOnEarth() : std::nullopt; first && !origin)
    origin = originNear(*first);
  in.placed = origin.has_value();
  m.origin = origin.value_or(m.origin);
  note(in.placed
           ? "nav's origin is " + formatted("%.2f N %.2f E", m.origin.latitude / kRadiansPerDegree,
                                            m.origin.longitude / kRadiansPerDegree)
           : "nobody says where on the Earth the dive was: it has metres of its own, and tables no latitude");
  if (in.navigated)
    note("declination and time offsets are 0");
  else if (!in.nav_data && !in.control)
    note(
        "no navigation: poses are from the images alone; the model is level on its own plane, its north is "
        "the top of the first image, its depth 0 that of the first camera");
}

void digestFile(Hasher& hasher, const fs::path& path) {
  hasher.add(path.filename().string());
  if (fs::exists(path)) hasher.add(digestOfFile(path));
}

void takeControl(MissionInput& in, const InputOptions& options) {
  const fs::path own = in.paths.root / "control";
  if (options.control.empty() && !fs::is_directory(own)) return;
  const fs::path& folder = options.control.empty() ? own : options.control;
  if (in.given_poses)
    throw InputError(
        folder.string(), "",
        "holds control points, which poses that are given (--poses) leave nothing to do for; take "
        "away one of them");
  in.control = readControlPoints(folder, options.control_crs);
  Hasher hasher;
  hasher.add(options.control_crs);
  for (const char* table : kControlTables) digestFile(hasher, folder / table);
  in.control_identity = hasher.finish();
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

void takeMasks(MissionInput& in, const InputOptions& options) {
  const fs::path own = in.paths.root / "masks";
  if (options.masks.empty() && !fs::is_directory(own)) return;
  const fs::path& path = options.masks.empty() ? own : options.masks;
  if (in.features_only)
    throw InputError(path.string(), "", "holds masks, and the mission no images, but features alone");
  std::vector<Camera> cameras;
  for (std::size_t number = 0; number < in.cameras(); ++number) cameras.push_back(in.camera(number));
  in.masks = std::make_shared<const ImageMasks>(path, std::move(cameras));
  Hasher hasher;
  for (const fs::path& file : in.masks->filesOfAll()) addIdentity(hasher, file, in.verify);
  in.mask_identity = hasher.finish();
  in.assumed.push_back("masks: " + path.string() + " (black is left out)");
}

void takeRegion(MissionInput& in, const InputOptions& options) {
  const fs::path own = in.paths.root / "region.geojson";
  if (options.region.empty() && !fs::exists(own)) return;
  const fs::path& file = options.region.empty() ? own : options.region;
  in.region = std::make_shared<const Region>(file, in.origin());
  in.assumed.push_back("region: " + file.string() + ", " + formatted("%.1f", in.region->area()) +
                       " m2 (nothing outside is modelled)");
}

}  // namespace

const Camera& MissionInput::camera(std::size_t number) const {
  return number == 0 ? rig.left : number == 1 ? rig.right : colour_cameras[number - 2].camera;
}

SE3 MissionInput::T_cam_left(std::size_t number) const {
  return number == 0 ? SE3() : number == 1 ? rig.T_right_left : colour_cameras[number - 2].T_cam_left;
}

PixelFormat MissionInput::format(std::size_t number) const {
  return number == 0   ? mission.cameras.left_format
         : number == 1 ? mission.cameras.right_format
                       : colour_cameras[number - 2].format;
}

int MissionInput::bits(std::size_t number) const {
  return number < 2 ? mission.cameras.bits : colour_cameras[number - 2].bits;
}

io::ImageFile MissionInput::image(const ImagePair& pair, std::size_t number) const {
  const std::string& name = number == 0 ? pair.left : number == 1 ? pair.right : pair.colour[number - 2];
  const Camera& camera = this->camera(number);
  const fs::path path = paths.images() / name;
  if (name.empty()) throw InputError(paths.images() / pair.left, "", "has no image of a colour camera");
  io::ImageFile file;
  if (described && number < 2) {
    file = io::readImage(path, format(number), bits(number), camera.width, camera.height);
  } else {
    file = readSamples(path, number < 2 ? samples[number] : colour_cameras[number - 2].samples);
    requireSize(file, camera, path);
    file = fitted(std::move(file), format(number), bits(number), path);
  }
  if (masks) file.mask = masks->of(name, number);
  file.view.mask = file.mask.get();
  return file;
}

Digest MissionInput::imageIdentity(const ImagePair& pair) const {
  Hasher hasher;
  std::vector<std::string> names{pair.left, pair.right};
  for (const std::string& name : pair.colour)
    if (!name.empty()) names.push_back(name);
  if (features_only)
    addIdentity(hasher, paths.features() / io::featureFileName(pair.left), verify);
  else
    for (const std::string& name : names) addIdentity(hasher, paths.images() / name, verify);
  if (masks) {
    hasher.add(mask_identity);
    for (const std::string& name : names)
      if (const fs::path file = masks->fileOf(name); !file.empty()) addIdentity(hasher, file, verify);
  }
  return hasher.finish();
}

void addPose(Hasher& hasher, const SE3& pose) {
  const Eigen::Vector4d& q = pose.rotation().coeffs();
  const Eigen::Vector3d& t = pose.translation();
  hasher.add(q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z());
}

void addRig(Hasher& hasher, const MissionInput& input) {
  for (std::size_t number = 0; number < input.cameras(); ++number) {
    const Camera& c = input.camera(number);
    hasher.add(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3);
    if (const auto& p = c.port)
      hasher.add(p->normal.x(), p->normal.y(), p->normal.z(), p->distance, p->glass, p->glass_index,
                 p->water_index);
    if (number < 2) continue;
    addPose(hasher, input.T_cam_left(number));
    hasher.add(input.format(number), input.bits(number), input.colour_cameras[number - 2].samples);
  }
  addPose(hasher, input.rig.T_right_left);
  if (input.colours)
    for (const double number : input.colours->reshaped()) hasher.add(number);
  const io::MissionConfig& m = input.mission;
  addPose(hasher, m.T_body_cam);
  addPose(hasher, m.T_body_dvl);
  hasher.add(m.cameras.left_format, m.cameras.right_format, m.cameras.bits, input.features_only);
  if (!input.described) hasher.add(input.samples[0], input.samples[1]);
}

void sayAssumed(const MissionInput& input) {
  for (const std::string& line : input.assumed) std::fprintf(stderr, "assumed: %s\n", line.c_str());
}

MissionInput openMission(const fs::path& folder, const InputOptions& options) {
  MissionInput in;
  in.paths = io::MissionPaths(folder);
  in.verify = options.verify;
  in.described = fs::exists(folder / "mission.toml");
  const fs::path own_poses = folder / "stereo_pose_est.data";
  fs::path poses = options.poses;
  if (poses.empty() && !in.described && fs::exists(own_poses)) poses = own_poses;
  if (!poses.empty()) in.given_poses = io::readStereoPoses(poses);
  in.navigated = in.described || !poses.empty() || in.paths.rawAuv();
  in.mounted = !options.mount.empty();
  if (in.described && (in.mounted || !options.nav.files.empty()))
    throw InputError((folder / "mission.toml").string(), "",
                     "says where cameras and navigation are; --mount and --nav are for folders without it");
  // A log of this project's without its mission.toml is a damaged mission, and nothing to guess about.
  if (in.described || fs::exists(in.paths.log())) in.mission = io::readMissionConfig(folder);
  in.features_only = io::isFeatureMission(in.paths);
  in.paths.calib_elsewhere = options.calib.empty() && !in.described ? findCalibration(folder) : options.calib;
  const Calibration calibration = readCalibration(in.paths.calib(), options.calib_unit);
  in.rig = calibration.rig;
  if (!calibration.about.empty()) in.assumed.push_back("calibration: " + calibration.about);
  takeControl(in, options);
  if (!in.described) assumeMission(in, options);
  if (in.control) in.control->placeAbout(in.mission.origin);
  takeSizes(in.rig, in.paths.calib(), {0, 0}, {0, 0});
  in.colour_cameras = openColourCameras(options.colour, options.calib_unit, in.rig.left, in.assumed);
  takeMasks(in, options);
  takeRegion(in, options);
  if (in.rig.left.port) in.assumed.push_back("flat ports: " + portsBeside(in.paths.calib()).string());

  in.colours = readColours(in.paths.calib());
  if (in.colours) in.assumed.push_back("colours: " + coloursBeside(in.paths.calib()).string());

  Hasher hasher;
  digestFile(hasher, folder / "mission.toml");
  digestFile(hasher, in.paths.calib());
  digestFile(hasher, portsBeside(in.paths.calib()));
  if (in.colours) digestFile(hasher, coloursBeside(in.paths.calib()));
  if (in.given_poses) {
    digestFile(hasher, poses);
  } else if (fs::exists(in.paths.log())) {
    digestFile(hasher, in.paths.log());
  } else if (const auto raw = in.paths.rawAuv()) {
    digestFile(hasher, *raw);
  }
  for (const fs::path& file : options.nav.files) digestFile(hasher, file);
  for (const ColourCamera& camera : in.colour_cameras)
    for (const fs::path& file : camera.files) hasher.add(file.generic_string());
  if (in.masks)
    for (const fs::path& file : in.masks->files()) addIdentity(hasher, file, in.verify);
  hasher.add(options.nav.columns, options.nav.crs, options.nav.declination, options.nav.offset,
             options.nav.sigma, in.mounted);
  if (in.files) {
    for (const StereoFilePair& pair : in.files->pairs)
      hasher.add(pair.left.generic_string(), pair.right.generic_string(), pair.utc_ns.value_or(-1));
  } else {
    std::vector<std::string> names;
    std::error_code error;
    for (const auto& entry :
         fs::directory_iterator(in.features_only ? in.paths.features() : in.paths.images(), error))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    for (const std::string& name : names) hasher.add(name);
  }
  in.identity = hasher.finish();
  return in;
}

}  // namespace fathom::topside
