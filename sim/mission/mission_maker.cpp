#include "sim/mission/mission_maker.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "firmware_if/mission/feature_file.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/features/feature_camera.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/sea/photograph.hpp"
#include "sim/sea/sea_terrain.hpp"
#include "sim/sensors/sensors.hpp"

namespace fathom::sim {
namespace {

Eigen::Vector3d drawDirection(Random& random) {
  const double x = random.gauss(), y = random.gauss(), z = random.gauss();
  return Eigen::Vector3d(x, y, z).normalized();
}

double drawSign(Random& random) {
  return random.uniform() < 0.5 ? -1 : 1;
}

// A rotation by `angle` about a random axis and a translation by `shift` in a random direction.
SE3 drawMotion(Random& random, double angle, double shift) {
  const Eigen::AngleAxisd turn(angle, drawDirection(random));
  const Eigen::Vector3d moved = shift * drawDirection(random);
  return {Eigen::Quaterniond(turn), moved};
}

// A pose with a random error: its position by `shift`, its axes by `angle`, in the pose's parent frame.
SE3 disturbed(Random& random, const SE3& pose, double angle, double shift) {
  const SE3 off = drawMotion(random, angle, shift);
  return {off.rotation() * pose.rotation(), pose.translation() + off.translation()};
}

// The calibration as the mission's files state it (mission.toml and stereo.calib): the true one with the
// errors of calibration_errors, their directions and signs from a random stream of their own.
struct NominalRig {
  StereoRig rig;
  io::MissionConfig mission;
};
NominalRig nominalRig(const CalibrationErrors& errors, const StereoRig& rig, const io::MissionConfig& mission,
                      std::uint64_t seed) {
  Random random(seed, "calibration-errors");
  NominalRig out{rig, mission};
  for (Camera* camera : {&out.rig.left, &out.rig.right}) {
    const double longer = 1 + errors.focal * drawSign(random);
    camera->fx *= longer, camera->fy *= longer;
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const double off = errors.centre * camera->width;
    camera->cx += off * std::cos(angle), camera->cy += off * std::sin(angle);
    camera->k1 += errors.radial * drawSign(random);
  }
  out.rig.T_right_left = disturbed(random, rig.T_right_left, errors.rig_angle, errors.rig_position_m);
  const SE3 turned = SE3::fromEuler(errors.rig_x, errors.rig_y, errors.rig_z, Eigen::Vector3d::Zero());
  const SE3 apart(out.rig.T_right_left.rotation(),
                  (1 + errors.baseline) * out.rig.T_right_left.translation());
  out.rig.T_right_left = turned * apart;
  for (SE3* pose : {&out.mission.T_body_cam, &out.mission.T_body_dvl, &out.mission.T_body_compass})
    *pose = disturbed(random, *pose, errors.mounting_angle, errors.lever_arm_m);
  for (SE3* pose : {&out.mission.T_body_usbl, &out.mission.T_body_depth})
    *pose = disturbed(random, *pose, 0, errors.lever_arm_m);
  io::MissionConfig::TimeOffsets& t = out.mission.time_offsets;
  for (double* offset : {&t.dvl, &t.compass, &t.depth}) *offset += errors.time_s * drawSign(random);
  const double cameras = errors.time_s * drawSign(random);
  t.left_camera += cameras, t.right_camera += cameras;
  return out;
}

constexpr double kTruthRate = 50.0;  // of truth/trajectory.csv [1/s]

// The folder "<out>.partial", renamed to "<out>" by commit() and removed without it.
class PartialFolder {
 public:
  PartialFolder(std::filesystem::path out, bool force) : out_(std::move(out)), force_(force) {
    if (!out_.has_filename()) out_ = out_.parent_path();  // a trailing slash
    if (std::filesystem::exists(out_) && !std::filesystem::is_directory(out_))
      throw InputError(out_.string(), "", "is a file; name a folder for the mission");
    if (std::filesystem::exists(out_) && !std::filesystem::is_empty(out_) && !force_)
      throw InputError(out_.string(), "", "is not empty; name another folder, or replace it with --force");
    partial_ = out_.string() + ".partial";
    std::error_code error;
    std::filesystem::remove_all(partial_, error);
    if (!error) std::filesystem::create_directories(partial_, error);
    if (error)
      throw InputError(partial_.string(), "",
                       "cannot be created (" + error.message() + "); name another folder");
  }
  ~PartialFolder() {
    std::error_code ignored;
    if (!committed_) std::filesystem::remove_all(partial_, ignored);
  }
  PartialFolder(const PartialFolder&) = delete;
  PartialFolder& operator=(const PartialFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return partial_; }
  void commit() {
    std::filesystem::remove_all(out_);
    std::filesystem::rename(partial_, out_);
    committed_ = true;
  }

 private:
  std::filesystem::path out_, partial_;
  bool force_;
  bool committed_ = false;
};

io::MissionConfig missionConfig(const Scenario& s, const StereoRig& rig) {
  io::MissionConfig m;
  m.vehicle_name = s.vehicle_name;
  m.vehicle_id = static_cast<std::uint8_t>(s.vehicle_id);
  m.dive_id = static_cast<std::uint16_t>(s.dive_id);
  m.software_version = "fathom-sim " FATHOM_VERSION;
  m.configuration =
      "scenario " + s.name + ", seed " + std::to_string(s.seed) + "; every key is in truth/scenario.toml";
  m.origin = s.origin;
  m.start_utc_ns = s.start_utc_ns;
  m.magnetic_declination = s.magnetic_declination;
  if (s.sensors.tide.amplitude_m > 0 && s.sensors.tide.in_mission != 0) {
    m.tide_model = formatted("sinusoid amplitude_m=%.17g period_s=%.17g phase_rad=%.17g",
                             s.sensors.tide.amplitude_m, s.sensors.tide.period_s, s.sensors.tide.phase);
  }
  m.water.sound_speed =
      soundSpeed(s.sensors.water.temperature_c, s.sensors.water.salinity_psu, s.terrain.base_depth_m);
  m.cameras.left_serial = "SIM-" + std::to_string(rig.left.width) + "L";
  m.cameras.right_serial = "SIM-" + std::to_string(rig.right.width) + "R";
  m.cameras.left_format = s.optics.sensor.left_format;
  m.cameras.right_format = s.optics.sensor.right_format;
  m.cameras.bits = s.optics.sensor.bits;
  m.cameras.rate_hz = s.sensors.cameras.rate_hz;
  m.T_body_cam = s.T_body_cam();
  m.T_body_dvl = s.T_body_dvl;
  m.T_body_usbl = s.T_body_usbl;
  m.T_body_depth = s.T_body_depth;
  m.T_body_compass = s.T_body_compass;
  // The clocks' offsets as measured before the dive; their drift is not known.
  const CameraClockConfig& clocks = s.sensors.cameras;
  Random random(static_cast<std::uint64_t>(s.seed), "camera-clocks");
  m.time_offsets.left_camera = -clocks.left_offset_s + random.uniform(-clocks.known_to_s, clocks.known_to_s);
  m.time_offsets.right_camera =
      -clocks.right_offset_s + random.uniform(-clocks.known_to_s, clocks.known_to_s);
  for (const SurveyLine& line : surveyLines(s.plan)) {
    m.plan.push_back({line.from.x(), line.from.y()});
    m.plan.push_back({line.to.x(), line.to.y()});
  }
  return m;
}

void writeMissionTruth(const std::filesystem::path& folder, const Scenario& scenario,
                       const SensorWorld& world, const SeaTerrain& terrain,
                       const std::vector<Exposure>& exposures) {
  std::filesystem::create_directories(folder);
  std::vector<io::TrajectoryPoint> points;
  for (std::int64_t i = 0; static_cast<double>(i) / kTruthRate <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / kTruthRate;
    points.push_back({world.utcNs(time), world.trajectory.poseAt(time)});
  }
  io::writeTrajectory(folder / "trajectory.csv", points);

  AtomicFile images(folder / "images.csv");
  images.stream() << "utc_ns,left_image,right_image\n";
  for (const Exposure& e : exposures) {
    images.stream() << world.utcNs(e.time_s) << ','
                    << io::imageFileName(e.left_stamp_ns, CameraSide::kLeft).view() << ','
                    << io::imageFileName(e.right_stamp_ns, CameraSide::kRight).view() << '\n';
  }
  images.commit();

  writeFile(folder / "scenario.toml", scenarioToml(scenario));
  writePly(folder / "terrain.ply", terrain.mesh(), {"true seafloor in nav: north, east, down [m]"});
}

// Seed of the noise of one image.
std::uint64_t noiseSeed(const Scenario& scenario, CameraSide side, std::size_t index) {
  return streamSeed(static_cast<std::uint64_t>(scenario.seed),
                    (side == CameraSide::kLeft ? "left-image-" : "right-image-") + std::to_string(index));
}

// Light, water and exposure of each pair.
std::vector<PhotoConditions> photoConditions(const Scenario& scenario,
                                             const std::vector<Exposure>& exposures) {
  const OpticsConfig& optics = scenario.optics;
  const auto seed = static_cast<std::uint64_t>(scenario.seed);
  Random random(seed, "flashes"), misfires(seed, "misfires"), water(seed, "water");
  const WaterPatches patches(water);
  std::vector<PhotoConditions> out(exposures.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    PhotoConditions& m = out[k];
    const double energy = std::max(1 + random.gauss(optics.flash_sigma), 0.0);
    const bool dark = random.uniform() < optics.dark_probability;
    for (const StrobeConfig& strobe : optics.strobes) {
      const bool misfire = misfires.uniform() < optics.misfire_probability;
      m.flashes.push_back(dark || misfire || exposures[k].time_s >= strobe.dies_at_s ? 0 : energy);
    }
    m.turbidity = std::max(0.05, 1 + optics.water.patches * patches.sediment.at(exposures[k].time_s));
    for (const Silt& silt : optics.water.silt) {
      const double since = exposures[k].time_s - silt.at_s;
      if (since >= 0) m.turbidity += (silt.times - 1) * std::exp(-since / silt.settles_s);
    }
    m.exposure = exposures[k].over_usual;
    m.snow_seed = streamSeed(seed, "snow-" + std::to_string(k));
  }
  return out;
}

void writePhotoConditions(const std::filesystem::path& file, const SensorWorld& world,
                          const std::vector<Exposure>& exposures,
                          const std::vector<PhotoConditions>& conditions) {
  AtomicFile out(file);
  out.stream() << "utc_ns,turbidity,exposure";
  for (std::size_t s = 0; s < conditions.front().flashes.size(); ++s) out.stream() << ",strobe_" << s + 1;
  out.stream() << '\n';
  for (std::size_t k = 0; k < exposures.size(); ++k) {
    out.stream() << world.utcNs(exposures[k].time_s) << ',' << conditions[k].turbidity << ','
                 << conditions[k].exposure;
    for (const double flash : conditions[k].flashes) out.stream() << ',' << flash;
    out.stream() << '\n';
  }
  out.commit();
}

// Automatic exposure: sets each exposure from the range of the pair before.
void setExposures(const Renderer& renderer, const Scenario& scenario, const SensorWorld& world,
                  std::vector<Exposure>& exposures) {
  constexpr double kShortest = 0.1, kLongest = 10;
  for (std::size_t k = 1; k < exposures.size(); ++k) {
    const SE3 T_nav_cam = world.trajectory.poseAt(exposures[k - 1].time_s) * scenario.T_body_cam();
    const auto distance =
        world.cast_ray(T_nav_cam.translation(), T_nav_cam.rotation() * Eigen::Vector3d::UnitZ());
    if (distance)
      exposures[k].over_usual = std::pow(std::clamp(renderer.exposureFactor(*distance), kShortest, kLongest),
                                         scenario.optics.sensor.auto_exposure);
  }
}

// Pose of the body with the vibration of pumps and thrusters.
SE3 vibratingPose(const Scenario& scenario, const SensorWorld& world, std::size_t pair, double time_s) {
  const OpticsConfig& optics = scenario.optics;
  SE3 pose = world.trajectory.poseAt(time_s);
  if (optics.vibration_rad <= 0) return pose;
  Random random(static_cast<std::uint64_t>(scenario.seed), "vibration-" + std::to_string(pair));
  Vector6d twist = Vector6d::Zero();
  for (const int axis : {3, 4})
    twist(axis) = optics.vibration_rad *
                  std::sin(2 * std::numbers::pi * (random.uniform() + optics.vibration_hz * time_s));
  return pose * SE3::exp(twist);
}

void renderAll(const Renderer& renderer, const Scenario& scenario, const SensorWorld& world,
               const std::vector<Exposure>& exposures, const io::MissionPaths& paths,
               const MissionMakerOptions& options) {
  std::filesystem::create_directories(paths.images());
  const std::vector<PhotoConditions> conditions = photoConditions(scenario, exposures);
  if (!conditions.empty())
    writePhotoConditions(paths.truth() / "exposures.csv", world, exposures, conditions);
  const double open_s = scenario.optics.sensor.open_s;
  forEachPair(exposures.size(), options.progress, [&](std::size_t i) {
    const Exposure& e = exposures[i];
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const bool left = side == CameraSide::kLeft;
      const double time = e.time_s + (left ? 0 : scenario.sensors.cameras.right_delay_s);
      PhotoConditions shot = conditions[i];
      const SE3 pose = vibratingPose(scenario, world, i, time);
      if (open_s > 0)
        shot.T_begin_end = vibratingPose(scenario, world, i, time - 0.5 * open_s).inverse() *
                           vibratingPose(scenario, world, i, time + 0.5 * open_s);
      photograph(renderer, pose, time, side, noiseSeed(scenario, side, i),
                 paths.images() / io::imageFileName(left ? e.left_stamp_ns : e.right_stamp_ns, side).view(),
                 shot);
    }
  });
}

void observeAll(const SeaTerrain& terrain, const Scenario& scenario, const StereoRig& rig,
                const SensorWorld& world, const std::vector<Exposure>& exposures,
                const std::filesystem::path& folder, const MissionMakerOptions& options) {
  std::filesystem::create_directories(folder);
  const auto seed = static_cast<std::uint64_t>(scenario.seed);
  SimulatedFeatureConfig features = scenario.features;
  if (!features.match_errors.empty())
    features.match_errors = scenario.file.parent_path() / features.match_errors;
  const FeatureCamera camera(terrain, features, scenario.optics, rig, scenario.T_body_cam(), seed);
  forEachPair(exposures.size(), options.progress, [&](std::size_t i) {
    const Exposure& e = exposures[i];
    const std::string name = io::imageFileName(e.left_stamp_ns, CameraSide::kLeft);
    const auto seen =
        camera.observe(world.trajectory.poseAt(e.time_s), streamSeed(seed, "features-" + std::to_string(i)));
    io::writeFeatureFile(folder / io::featureFileName(name), seen.frame);
  });
}

MissionMakerReport reportOf(const SensorWorld& world, const WideSeafloor& seafloor,
                            const std::vector<Exposure>& exposures, std::size_t samples) {
  MissionMakerReport report;
  report.pairs = exposures.size();
  report.samples = samples;
  if (exposures.empty()) return report;
  report.survey_s = exposures.back().time_s - exposures.front().time_s;
  report.lowest_m = 1e9;
  Eigen::Vector3d previous = world.trajectory.poseAt(exposures.front().time_s).translation();
  for (const Exposure& e : exposures) {
    const Eigen::Vector3d place = world.trajectory.poseAt(e.time_s).translation();
    const double altitude = seafloor.depthAt(place.x(), place.y()) - place.z();
    report.lowest_m = std::min(report.lowest_m, altitude);
    report.highest_m = std::max(report.highest_m, altitude);
    report.track_m += (place - previous).head<2>().norm();
    previous = place;
  }
  return report;
}

MissionMakerReport makeMissionFolder(const Scenario& scenario, const MissionMakerOptions& options) {
  PartialFolder folder(options.out, options.force);
  const io::MissionPaths paths(folder.path());
  const StereoRig rig = scenario.stereoRig();

  const SeaTerrain terrain(resolvedTerrain(scenario));
  const WideSeafloor seafloor(terrain);
  const auto seed = static_cast<std::uint64_t>(scenario.seed);
  const Trajectory trajectory = simulateVehicle(
      scenario.plan, scenario.vehicle,
      [&](double north, double east) { return seafloor.depthAt(north, east); }, seed,
      scenario.longest_survey_s);
  const SensorWorld world{
      trajectory,
      [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) { return seafloor.castRay(from, to); },
      scenario.origin,
      scenario.start_utc_ns,
      scenario.magnetic_declination,
      scenario.T_body_dvl,
      scenario.T_body_usbl,
      scenario.T_body_depth,
      scenario.T_body_compass,
      seed};
  std::vector<Exposure> exposures = simulateExposures(world, scenario.sensors.cameras);
  std::optional<Renderer> renderer;
  if (!options.features) {
    renderer.emplace(terrain, scenario.optics, rig, scenario.T_body_cam());
    if (scenario.optics.sensor.auto_exposure > 0) setExposures(*renderer, scenario, world, exposures);
  }
  const LoggedSamples samples = simulateSensors(world, scenario.sensors, exposures);

  const io::MissionConfig mission = missionConfig(scenario, rig);
  const NominalRig nominal = nominalRig(scenario.calibration_errors, rig, mission, seed);
  io::writeMissionConfig(paths.root, nominal.mission);
  writeStereoCalib(paths.calib(), nominal.rig);
  {
    io::SensorLogWriter log(paths.log(), scenario.vehicle_name);
    for (const io::LoggedSample& s : samples) log.write(s.arrival_utc_ns, s.sample);
    log.flush();
  }
  io::deriveRawAuv(paths.root);
  writeMissionTruth(paths.truth(), scenario, world, terrain, exposures);
  io::writeMissionConfig(paths.truth(), mission);
  writeStereoCalib(io::MissionPaths(paths.truth()).calib(), rig);
  if (options.features)
    observeAll(terrain, scenario, rig, world, exposures, paths.features(), options);
  else
    renderAll(*renderer, scenario, world, exposures, paths, options);
  folder.commit();
  return reportOf(world, seafloor, exposures, samples.size());
}

}  // namespace

MissionMakerReport makeMission(const Scenario& scenario, const MissionMakerOptions& options) {
  MissionMakerReport report;
  withThreads(options.threads, [&] { report = makeMissionFolder(scenario, options); });
  return report;
}

}  // namespace fathom::sim
