#include "sim/sensors/sensors.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/units.hpp"
#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

constexpr double kGravity = 9.81;  // [m/s^2]
constexpr int kComponents = 80;
// Frequency range of the spectrum over its peak's; less than 2 % of the variance is outside.
constexpr double kLowest = 0.5, kHighest = 4.0;
constexpr int kSpectrumBins = 2000;

// JONSWAP's density of the variance, not scaled, at a frequency over the peak's.
double density(double f) {
  constexpr double kEnhancement = 3.3;
  const double width = f <= 1 ? 0.07 : 0.09;
  const double bump = std::exp(-(f - 1) * (f - 1) / (2 * width * width));
  return std::pow(f, -5) * std::exp(-1.25 * std::pow(f, -4)) * std::pow(kEnhancement, bump);
}

// k of omega^2 = g k tanh(k h), by Newton's iteration.
double waveNumber(double rate, double water_depth_m) {
  const double deep = rate * rate / kGravity * water_depth_m;  // k h in deep water
  double kh = std::max(deep, std::sqrt(deep));
  constexpr int kIterations = 20;
  for (int i = 0; i < kIterations; ++i) {
    const double t = std::tanh(kh);
    kh -= (kh * t - deep) / (t + kh * (1 - t * t));
  }
  return kh / water_depth_m;
}

}  // namespace

Waves::Waves(const WavesConfig& config, std::uint64_t seed, double water_depth_m)
    : water_depth_m_(water_depth_m) {
  if (config.height_m <= 0) return;
  Random random(seed, "waves");
  constexpr double kStep = (kHighest - kLowest) / kSpectrumBins;
  std::vector<double> up_to(kSpectrumBins + 1, 0.0);
  for (int i = 0; i < kSpectrumBins; ++i)
    up_to[static_cast<std::size_t>(i) + 1] =
        up_to[static_cast<std::size_t>(i)] + density(kLowest + (i + 0.5) * kStep);
  const double amplitude = config.height_m / 4 * std::sqrt(2.0 / kComponents);
  for (int i = 0; i < kComponents; ++i) {
    const double share = (i + random.uniform()) / kComponents * up_to.back();
    const auto after = std::upper_bound(up_to.begin(), up_to.end(), share);
    const auto bin = static_cast<std::size_t>(after - up_to.begin()) - 1;
    const double within = (share - up_to[bin]) / (up_to[bin + 1] - up_to[bin]);
    const double relative = kLowest + (static_cast<double>(bin) + within) * kStep;
    const double rate = 2 * std::numbers::pi / config.period_s * relative;
    const double towards = config.towards + random.gauss(config.spreading);
    const double number = waveNumber(rate, water_depth_m);
    components_.push_back({amplitude, rate, random.uniform(0.0, 2 * std::numbers::pi),
                           number * Eigen::Vector2d(std::cos(towards), std::sin(towards))});
  }
}

double Waves::heightAt(const Eigen::Vector2d& place, double time_s) const {
  double sum = 0;
  for (const Component& c : components_) sum += c.amplitude * std::cos(c.phaseAt(place, time_s));
  return sum;
}

double Waves::pressureAt(const Eigen::Vector3d& place, double water_depth_m, double time_s) const {
  const double below = std::clamp(place.z(), 0.0, water_depth_m);
  double sum = 0;
  for (const Component& c : components_) {
    const double k = c.number.norm();
    // cosh(k (h - z)) / cosh(k h) without overflow in deep water.
    const double left = std::exp(-k * below) * (1 + std::exp(-2 * k * (water_depth_m - below))) /
                        (1 + std::exp(-2 * k * water_depth_m));
    sum += left * c.amplitude * std::cos(c.phaseAt(place.head<2>(), time_s));
  }
  return sum;
}

Eigen::Vector2d Waves::shiftAt(const Eigen::Vector2d& place, double time_s) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Component& c : components_) {
    const double k = c.number.norm();
    sum -= c.amplitude / std::tanh(k * water_depth_m_) * std::sin(c.phaseAt(place, time_s)) * c.number / k;
  }
  return sum;
}

double soundSpeed(double t, double s, double d) {
  return 1448.96 + 4.591 * t - 5.304e-2 * t * t + 2.374e-4 * t * t * t + 1.340 * (s - 35.0) + 1.630e-2 * d +
         1.675e-7 * d * d - 1.025e-2 * t * (s - 35.0) - 7.139e-13 * t * d * d * d;
}

double practicalSalinity(double t, double conductivity_s_per_m) {
  constexpr double kStandardConductivity = 4.2914;  // of water of 35 psu at 15 deg C [S/m]
  const double ratio = conductivity_s_per_m / kStandardConductivity;
  const double rt = 0.6766097 + t * (2.00564e-2 + t * (1.104259e-4 + t * (-6.9698e-7 + t * 1.0031e-9)));
  const double x = std::sqrt(ratio / rt);
  const double s = 0.0080 + x * (-0.1692 + x * (25.3851 + x * (14.0941 + x * (-7.0261 + x * 2.7081))));
  const double ds = 0.0005 + x * (-0.0056 + x * (-0.0066 + x * (-0.0375 + x * (0.0636 + x * -0.0144))));
  return s + (t - 15.0) / (1.0 + 0.0162 * (t - 15.0)) * ds;
}

double conductivity(double temperature_c, double salinity_psu) {
  // Salinity grows with conductivity: bisection between bounds beyond any sea.
  constexpr int kHalvings = 60;
  double low = 0.0, high = 10.0;  // [S/m]
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (practicalSalinity(temperature_c, middle) < salinity_psu ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

std::int64_t SensorWorld::utcNs(double time_s) const {
  return start_utc_ns + rt::nanoseconds(time_s);
}

double SensorWorld::waterDepthAt(const Eigen::Vector2d& place) const {
  constexpr double kNoBottom = 1000;  // [m]
  return cast_ray({place.x(), place.y(), 0}, Eigen::Vector3d::UnitZ()).value_or(kNoBottom);
}

Waves SensorWorld::waves(const WavesConfig& config) const {
  return {config, seed, waterDepthAt(trajectory.poseAt(0).translation().head<2>())};
}

std::vector<Exposure> simulateExposures(const SensorWorld& world, const CameraClockConfig& config) {
  std::vector<Exposure> exposures;
  constexpr double kRounding = 1e-6;  // [s]
  const double begin = world.trajectory.surveyBegin();
  for (int i = 0; begin + i / config.rate_hz < world.trajectory.surveyEnd() - kRounding; ++i) {
    const double time = begin + i / config.rate_hz;
    exposures.push_back({time, world.utcNs(time + config.left_offset_s + config.left_drift * time),
                         world.utcNs(time + config.right_offset_s + config.right_drift * time)});
  }
  return exposures;
}

namespace {

// Applies arrival delays and stamp errors to DVL, compass and depth.
void delayArrivals(const SensorWorld& world, const ArrivalConfig& config, LoggedSamples& samples) {
  Random random(world.seed, "arrival");
  for (io::LoggedSample& s : samples) {
    std::visit(
        [&](auto& sample) {
          using Sample = std::decay_t<decltype(sample)>;
          if constexpr (std::is_same_v<Sample, DvlSample> || std::is_same_v<Sample, AttitudeSample> ||
                        std::is_same_v<Sample, DepthSample>) {
            const double late = -config.jitter_s * std::log(1 - random.uniform());
            const double stamp = random.gauss(config.stamp_jitter_s);
            s.arrival_utc_ns += rt::nanoseconds(late);
            const std::int64_t batch = rt::nanoseconds(config.batch_s);
            if (batch > 0) s.arrival_utc_ns += batch - 1 - (s.arrival_utc_ns - 1) % batch;
            sample.utc_ns = std::min<std::int64_t>(sample.utc_ns + rt::nanoseconds(stamp), s.arrival_utc_ns);
          }
        },
        s.sample);
  }
}

}  // namespace

LoggedSamples simulateSensors(const SensorWorld& world, const SensorsConfig& config,
                              const std::vector<Exposure>& exposures) {
  LoggedSamples samples;
  simulateGps(world, config, samples);
  simulateUsbl(world, config.usbl, samples);
  simulateWater(world, config.water, samples);
  simulateBattery(world, config.battery, samples);
  simulateDepth(world, config, samples);
  simulateCompass(world, config.compass, samples);
  simulateGyro(world, config.gyro, samples);
  simulateDvl(world, config, samples);
  for (const Exposure& exposure : exposures) {
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      ImageEvent event;
      event.utc_ns = side == CameraSide::kLeft ? exposure.left_stamp_ns : exposure.right_stamp_ns;
      event.side = side;
      event.file_name = io::imageFileName(event.utc_ns, side);
      event.exposure_s = config.cameras.exposure_s * exposure.over_usual;
      samples.push_back({world.utcNs(exposure.time_s + config.cameras.latency_s), event});
    }
  }
  const ArrivalConfig& arrival = config.arrival;
  if (arrival.jitter_s > 0 || arrival.batch_s > 0 || arrival.stamp_jitter_s > 0)
    delayArrivals(world, arrival, samples);
  std::stable_sort(samples.begin(), samples.end(), [](const io::LoggedSample& a, const io::LoggedSample& b) {
    return a.arrival_utc_ns < b.arrival_utc_ns;
  });
  return samples;
}

WaterPatches::WaterPatches(Random& random)
    : plankton(random, 0.2, 40.0, 400.0), sediment(random, 0.3, 20.0, 300.0) {}

void simulateWater(const SensorWorld& world, const WaterSensorConfig& config, LoggedSamples& samples) {
  if (config.rate_hz == 0) return;
  Random random(world.seed, "water");
  const WaterPatches patches(random);
  const double true_conductivity = conductivity(config.temperature_c, config.salinity_psu);
  const auto optical = [&](double mean, double patch) {
    return std::max(0.0, mean * (1.0 + patch + random.gauss(config.optics_relative_sigma)));
  };
  for (std::int64_t i = 0; static_cast<double>(i) / config.rate_hz <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) / config.rate_hz;
    const double depth = world.trajectory.poseAt(time).translation().z();
    WaterSample sample;
    sample.utc_ns = world.utcNs(time);
    sample.temperature = config.temperature_c + random.gauss(config.temperature_sigma_c);
    sample.conductivity = true_conductivity + random.gauss(config.conductivity_sigma);
    sample.sound_speed =
        soundSpeed(*sample.temperature, practicalSalinity(*sample.temperature, *sample.conductivity), depth);
    sample.chlorophyll = optical(config.chlorophyll_ug_l, patches.plankton.at(time));
    sample.cdom = optical(config.cdom_ppb, 0.5 * patches.plankton.at(time));
    sample.turbidity = optical(config.turbidity, patches.sediment.at(time));
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

void simulateBattery(const SensorWorld& world, const BatteryConfig& config, LoggedSamples& samples) {
  constexpr double kSecondsPerHour = 3600;
  double charge = config.start_charge;
  const double step = 1 / config.rate_hz;
  for (std::int64_t i = 0; static_cast<double>(i) * step <= world.trajectory.duration(); ++i) {
    const double time = static_cast<double>(i) * step;
    const double speed = world.trajectory.at(time).velocity_nav.norm();
    const double power = config.hotel_w + config.thrust_w_per_m3ps3 * std::pow(speed, 3);
    if (i > 0) charge = std::max(0.0, charge - power * step / kSecondsPerHour / config.capacity_wh);
    const double open_v = config.empty_v + (config.full_v - config.empty_v) * charge;
    BatterySample sample;
    sample.utc_ns = world.utcNs(time);
    sample.current = power / open_v;
    sample.voltage = open_v - *sample.current * config.resistance_ohm;
    sample.charge = charge;
    samples.push_back({world.utcNs(time + config.latency_s), sample});
  }
}

}  // namespace fathom::sim
