#include "sim/mission/mission_maker.hpp"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <mutex>
#include <numbers>
#include <optional>
#include <thread>
#include <vector>

#include "firmware_if/files/feature_file.hpp"
#include "firmware_if/files/images/image_file.hpp"
#include "firmware_if/files/mission.hpp"
#include "firmware_if/files/mission_folder.hpp"
#include "firmware_if/files/pose_files.hpp"
#include "firmware_if/files/sensor_log.hpp"
#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "sim/features/feature_camera.hpp"
#include "sim/mission/told_rig.hpp"
#include "sim/mission/wide_seafloor.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"
#include "sim/sea/photograph.hpp"
#include "sim/sea/terrain.hpp"
#include "sim/sensors/water_properties.hpp"

namespace fathom::sim {
namespace {

constexpr double kTruthRate = 50.0;  // of truth/trajectory.csv [1/s]

// A folder that is being written; removed again unless it is whole.
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
                       "cannot be made (" + error.message() + "); name another folder");
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

void writeTruth(const std::filesystem::path& folder, const Scenario& scenario, const SensorWorld& world,
                const Terrain& terrain, const std::vector<Exposure>& exposures) {
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

// The noise of an image is its own.
std::uint64_t noiseSeed(const Scenario& scenario, CameraSide side, std::size_t index) {
  return streamSeed(static_cast<std::uint64_t>(scenario.seed),
                    (side == CameraSide::kLeft ? "left-image-" : "right-image-") + std::to_string(index));
}

// What differs from pair to pair.
std::vector<Moment> momentsOf(const Scenario& scenario, const std::vector<Exposure>& exposures) {
  const OpticsConfig& optics = scenario.optics;
  const auto seed = static_cast<std::uint64_t>(scenario.seed);
  Random random(seed, "flashes"), misfires(seed, "misfires"), water(seed, "water");
  const WaterPatches patches(water);
  std::vector<Moment> out(exposures.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    Moment& m = out[k];
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

void writeMoments(const std::filesystem::path& file, const SensorWorld& world,
                  const std::vector<Exposure>& exposures, const std::vector<Moment>& moments) {
  AtomicFile out(file);
  out.stream() << "utc_ns,turbidity,exposure";
  for (std::size_t s = 0; s < moments.front().flashes.size(); ++s) out.stream() << ",strobe_" << s + 1;
  out.stream() << '\n';
  for (std::size_t k = 0; k < exposures.size(); ++k) {
    out.stream() << world.utcNs(exposures[k].time_s) << ',' << moments[k].turbidity << ','
                 << moments[k].exposure;
    for (const double flash : moments[k].flashes) out.stream() << ',' << flash;
    out.stream() << '\n';
  }
  out.commit();
}

// An exposure that follows the altitude, a pair late.
void setExposures(const Renderer& renderer, const Scenario& scenario, const SensorWorld& world,
                  std::vector<Exposure>& exposures) {
  constexpr double kShortest = 0.1, kLongest = 10;
  for (std::size_t k = 1; k < exposures.size(); ++k) {
    const SE3 T_nav_cam = world.trajectory.poseAt(exposures[k - 1].time_s) * scenario.T_body_cam();
    const auto distance =
        world.cast_ray(T_nav_cam.translation(), T_nav_cam.rotation() * Eigen::Vector3d::UnitZ());
    if (distance)
      exposures[k].over_usual = std::pow(std::clamp(renderer.exposureAt(*distance), kShortest, kLongest),
                                         scenario.optics.sensor.auto_exposure);
  }
}

// Pose of the body at a moment, shaken by pumps and thrusters.
SE3 shaken(const Scenario& scenario, const SensorWorld& world, std::size_t pair, double time_s) {
  const OpticsConfig& optics = scenario.optics;
  const SE3 pose = world.trajectory.poseAt(time_s);
  if (optics.vibration_rad <= 0) return pose;
  Random random(static_cast<std::uint64_t>(scenario.seed), "vibration-" + std::to_string(pair));
  Vector6d twist = Vector6d::Zero();
  for (const int axis : {3, 4})
    twist(axis) = optics.vibration_rad *
                  std::sin(2 * std::numbers::pi * (random.uniform() + optics.vibration_hz * time_s));
  return pose * SE3::exp(twist);
}

// Calls make(i) for every exposure, in parallel; each writes its own files.
void makeAll(std::size_t count, const MissionMakerOptions& options,
             const std::function<void(std::size_t)>& make) {
  std::mutex mutex;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    // Isolated, so that a thread that waits inside one image does not begin another.
    tbb::this_task_arena::isolate([&] { make(i); });
    const std::lock_guard lock(mutex);
    ++done;
    if (options.progress) options.progress(done, count);
  });
}

void renderAll(const Renderer& renderer, const Scenario& scenario, const SensorWorld& world,
               const std::vector<Exposure>& exposures, const io::MissionPaths& paths,
               const MissionMakerOptions& options) {
  std::filesystem::create_directories(paths.images());
  const std::vector<Moment> moments = momentsOf(scenario, exposures);
  if (!moments.empty()) writeMoments(paths.truth() / "exposures.csv", world, exposures, moments);
  const double open_s = scenario.optics.sensor.open_s;
  makeAll(exposures.size(), options, [&](std::size_t i) {
    const Exposure& e = exposures[i];
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const bool left = side == CameraSide::kLeft;
      const double time = e.time_s + (left ? 0 : scenario.sensors.cameras.right_delay_s);
      Moment moment = moments[i];
      const SE3 pose = shaken(scenario, world, i, time);
      if (open_s > 0)
        moment.T_begin_end = shaken(scenario, world, i, time - 0.5 * open_s).inverse() *
                             shaken(scenario, world, i, time + 0.5 * open_s);
      photograph(renderer, pose, time, side, noiseSeed(scenario, side, i),
                 paths.images() / io::imageFileName(left ? e.left_stamp_ns : e.right_stamp_ns, side).view(),
                 moment);
    }
  });
}

void observeAll(const Terrain& terrain, const Scenario& scenario, const StereoRig& rig,
                const SensorWorld& world, const std::vector<Exposure>& exposures,
                const std::filesystem::path& folder, const MissionMakerOptions& options) {
  std::filesystem::create_directories(folder);
  const auto seed = static_cast<std::uint64_t>(scenario.seed);
  const FeatureCamera camera(terrain, scenario.features, scenario.optics, rig, scenario.T_body_cam(), seed);
  makeAll(exposures.size(), options, [&](std::size_t i) {
    const Exposure& e = exposures[i];
    const std::string name = io::imageFileName(e.left_stamp_ns, CameraSide::kLeft);
    const auto seen =
        camera.observe(world.trajectory.poseAt(e.time_s), streamSeed(seed, "features-" + std::to_string(i)));
    io::writeFeatureFile(folder / io::featureFileName(name), seen.frame);
  });
}

MissionMakerReport describe(const SensorWorld& world, const WideSeafloor& seafloor,
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

MissionMakerReport make(const Scenario& scenario, const MissionMakerOptions& options) {
  PartialFolder folder(options.out, options.force);
  const io::MissionPaths paths(folder.path());
  const StereoRig rig = scenario.stereoRig();

  const Terrain terrain(resolvedTerrain(scenario));
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
  const ToldRig told = toldRig(scenario.calibration_errors, rig, mission, seed);
  io::writeMissionConfig(paths.root, told.mission);
  writeStereoCalib(paths.calib(), told.rig);
  {
    io::SensorLogWriter log(paths.log(), scenario.vehicle_name);
    for (const io::LoggedSample& s : samples) log.write(s.arrival_utc_ns, s.sample);
    log.flush();
  }
  io::deriveRawAuv(paths.root);
  writeTruth(paths.truth(), scenario, world, terrain, exposures);
  io::writeMissionConfig(paths.truth(), mission);
  writeStereoCalib(io::MissionPaths(paths.truth()).calib(), rig);
  if (options.features)
    observeAll(terrain, scenario, rig, world, exposures, paths.features(), options);
  else
    renderAll(*renderer, scenario, world, exposures, paths, options);
  folder.commit();
  return describe(world, seafloor, exposures, samples.size());
}

}  // namespace

MissionMakerReport makeMission(const Scenario& scenario, const MissionMakerOptions& options) {
  const int threads = options.threads > 0
                          ? options.threads
                          : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  MissionMakerReport report;
  arena.execute([&] { report = make(scenario, options); });
  return report;
}

}  // namespace fathom::sim
