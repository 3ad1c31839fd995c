#include "sim/campaign/dive_plan.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "realtime/base/numbers/hash64.hpp"
#include "sim/scenario/random.hpp"
#include "sim/scenario/scenario_file.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kSingleUndisturbed = 2;

// Of one number of a series: streams of different series, seeds or numbers share nothing.
Random stream(DiveSeries series, std::uint64_t seed, const char* name, std::uint64_t number) {
  return {hash64(hash64(seed, static_cast<std::uint64_t>(series)), number), name};
}

double logUniform(Random& random, double low, double high) {
  return low * std::pow(high / low, random.uniform());
}

double signOf(Random& random) {
  return random.uniform() < 0.5 ? -1 : 1;
}

// Half of the sites have grown colours, half those of real photographs; a fifth each has the relief of a real
// reef and of a real multibeam survey, which is scaled down.
void drawSeafloor(Random& random, std::size_t site, TerrainConfig& t) {
  constexpr const char* kPhotographs[] = {"", "real/sirius/run1", "", "real/sirius/run3",
                                          "", "real/sirius/run8"};
  constexpr std::size_t kReliefs = 5;
  t.albedo_images = kPhotographs[site % std::size(kPhotographs)];
  if (site % kReliefs == 1) t.relief_file = "terrain/horseshoe_800x800_1cm.tif", t.relief_cell_m = 0.01;
  if (site % kReliefs == 3) t.relief_file = "terrain/JD211_public_Release_1-4_UTM.bag", t.relief_cell_m = 0.1;
  t.seed = static_cast<std::uint64_t>(random.uniform(0, 1e6));
  t.base_depth_m = logUniform(random, 12, 30);
  t.undulation_m = random.uniform(0.05, 0.4);
  t.undulation_wavelength_m = random.uniform(4, 9);
  t.roughness_m = random.uniform(0.001, 0.008);
  t.ripples.height_m = std::max(0.0, random.uniform(-0.04, 0.04));
  t.ripples.wavelength_m = logUniform(random, 0.15, 0.45);
  t.ripples.direction_rad = random.uniform(0, std::numbers::pi);
  t.rubble.density_per_m2 = random.uniform(0, 15);
  t.boulders.density_per_m2 = random.uniform(0, 0.08);
  t.corals.density_per_m2 = random.uniform(0, 0.15);
}

// Other baselines, fields of view and tilts of the cameras, chips and sensors.
void drawRig(Random& random, Scenario& s) {
  const double zoom = random.uniform(0.85, 1.35), wider = logUniform(random, 0.7, 2.2);
  for (Camera* camera : {&s.rig.left, &s.rig.right}) camera->fx *= zoom, camera->fy *= zoom;
  s.rig.T_right_left = SE3(s.rig.T_right_left.rotation(), wider * s.rig.T_right_left.translation());
  constexpr double kTilt = degreesToRadians(10.0);
  s.camera_euler.x() = random.uniform(-kTilt, kTilt), s.camera_euler.y() = random.uniform(-kTilt, kTilt);
  ImageSensorConfig& chip = s.optics.sensor;
  if (random.uniform() < 0.2) chip.bits = 8;
  if (random.uniform() < 0.2) chip.right_format = chip.left_format;
  chip.auto_exposure = random.uniform() < 0.4 ? 1 : 0;
  s.sensors.gyro.rate_hz = random.uniform() < 0.4 ? 10 : 0;
}

// A survey in footprints of the cameras: neighbouring images and lines overlap.
void drawSurvey(Random& random, Scenario& s) {
  constexpr double kPairs = 60;
  s.vehicle.follower.altitude_m = s.optics.sensor.exposure_distance_m = random.uniform(1.6, 3.1);
  s.vehicle.speed_mps = random.uniform(0.3, 0.65);
  const Camera& camera = s.rig.left;
  const double along = s.vehicle.follower.altitude_m * camera.height / camera.fy,
               across = s.vehicle.follower.altitude_m * camera.width / camera.fx;
  s.sensors.cameras.rate_hz = std::clamp(s.vehicle.speed_mps / (random.uniform(0.2, 0.4) * along), 0.5, 2.0);
  s.longest_survey_s = kPairs / s.sensors.cameras.rate_hz;
  s.plan.heading = random.uniform(-std::numbers::pi, std::numbers::pi);
  s.plan.lines = random.uniform() < 0.5 ? 2 : 3;
  s.plan.line_length = std::max(1.0, along * random.uniform(1.0, 1.8));
  s.plan.line_spacing = across * random.uniform(0.4, 0.75);
  const double side = std::max(s.plan.line_length, (s.plan.lines - 1) * s.plan.line_spacing);
  s.terrain.size_north_m = s.terrain.size_east_m =
      std::numbers::sqrt2 * side + 2 * across + 2 * (s.plan.overrun + 2 * s.vehicle.turn_radius_m);
}

void drawSite(DiveSeries series, std::uint64_t seed, std::size_t site, Scenario& s) {
  Random random = stream(series, seed, "site", site);
  drawSeafloor(random, site, s.terrain);
  drawRig(random, s);
  drawSurvey(random, s);
}

// Within the survey, which begins when the vehicle has come down.
Occasion drawOccasion(Random& random, const Scenario& s) {
  const double down_s =
      s.vehicle.float_s + (s.terrain.base_depth_m - s.vehicle.follower.altitude_m) / s.vehicle.dive_rate_mps;
  Occasion o;
  o.at_s = down_s + random.uniform() * s.longest_survey_s;
  o.sign = signOf(random);
  o.north_m = random.uniform(-1, 1), o.east_m = random.uniform(-1, 1);
  return o;
}

Scenario combined(const DivePlan& plan, std::uint64_t seed) {
  Scenario scenario = loadScenario("campaign");
  drawSite(plan.series, seed, undisturbedOf(plan), scenario);
  constexpr std::uint64_t kSeeds = 1ULL << 53;  // that a scenario can hold
  scenario.seed = static_cast<std::int64_t>(
      hash64(hash64(seed, static_cast<std::uint64_t>(plan.series)), plan.dive) % kSeeds);
  if (plan.undisturbed) return scenario;
  const std::vector<double> doses = dosesOf(plan, seed);
  Random random = stream(plan.series, seed, "occasions", plan.dive);
  const Scenario calm = scenario;
  for (std::size_t p = 0; p < doses.size(); ++p) {
    const Perturbation& perturbation = perturbations()[p];
    perturbation.disturb(scenario, perturbation.levelOf(doses[p]), drawOccasion(random, calm));
  }
  return scenario;
}

Scenario single(const DivePlan& plan, std::uint64_t seed) {
  Scenario scenario = loadScenario("campaign");
  // Undisturbed dives and the first round share one terrain; every further round has its own.
  const std::size_t round =
      plan.undisturbed ? 0
                       : (plan.dive - kSingleUndisturbed) / (perturbations().size() * Perturbation::kLevels);
  scenario.seed = static_cast<std::int64_t>(1000 * seed + plan.dive);
  scenario.terrain.seed += round;
  if (!plan.pictures) {
    scenario.plan.lines = 4;
    scenario.plan.line_length = 6;
    scenario.plan.cross_lines = 2;
    scenario.terrain.size_north_m = scenario.terrain.size_east_m = 14;
  }
  if (plan.perturbation >= 0) {
    const Perturbation& p = perturbations()[static_cast<std::size_t>(plan.perturbation)];
    p.disturb(scenario, p.levels[static_cast<std::size_t>(plan.level)], Occasion());
  }
  return scenario;
}

}  // namespace

DivePlan planOf(DiveSeries series, std::size_t dive) {
  DivePlan plan{.series = series, .dive = dive};
  if (series != DiveSeries::kSingle) {
    plan.undisturbed = dive < kSites;
    return plan;
  }
  plan.pictures = dive != 1;
  plan.undisturbed = dive < kSingleUndisturbed;
  if (plan.undisturbed) return plan;
  const std::size_t count = perturbations().size(), k = dive - kSingleUndisturbed;
  plan.perturbation = static_cast<int>(k % count);
  plan.level = static_cast<int>(k / count % Perturbation::kLevels);
  plan.pictures = perturbations()[k % count].pictures;
  return plan;
}

std::size_t undisturbedOf(const DivePlan& plan) {
  if (plan.series != DiveSeries::kSingle) return plan.dive % kSites;
  return plan.pictures ? 0 : 1;
}

std::vector<double> dosesOf(const DivePlan& plan, std::uint64_t seed) {
  if (plan.series == DiveSeries::kSingle) return {};
  std::vector<double> doses(perturbations().size(), 0.0);
  if (plan.undisturbed) return doses;
  constexpr double kBeyond = 0.1;
  Random random = stream(plan.series, seed, "doses", plan.dive);
  for (double& dose : doses) dose = std::log(1 - random.uniform()) / std::log(kBeyond);
  return doses;
}

Scenario diveScenario(const DivePlan& plan, std::uint64_t seed) {
  return plan.series == DiveSeries::kSingle ? single(plan, seed) : combined(plan, seed);
}

}  // namespace fathom::sim
