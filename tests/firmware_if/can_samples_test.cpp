#include "firmware_if/devices/can/samples/n2k_samples.hpp"

#include <gmock/gmock.h>

#include <variant>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/send/n2k_encoder.hpp"
#include "realtime/base/files/input_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/sea_water.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kFirstMessage_ns = 1'700'000'000 * kSecond_ns;
constexpr double kTrue = 0, kMagnetic = 1;

// Messages as devices send them, through the wire's bytes.
class Bus {
 public:
  explicit Bus(const N2kSamples::Config& config = {}) : samples(config) {}
  // At `ms` after the start.
  std::vector<SensorSample> receive(std::uint32_t pgn, std::int64_t ms, const std::vector<N2kValue>& values,
                                    std::uint8_t source = 10, std::size_t bytes = 8) {
    std::vector<std::uint8_t> payload(bytes);
    EXPECT_TRUE(encodeN2kPayload(pgn, values, payload));
    N2kMessage message;
    EXPECT_TRUE(decodeN2kPayload(pgn, payload, message));
    message.id = {3, pgn, source, 255};
    message.utc_ns = kFirstMessage_ns + ms * kMillisecond_ns;
    const auto out = samples.add(message);
    return {out.begin(), out.end()};
  }
  std::vector<SensorSample> heading(std::int64_t ms, double radians, double reference = kMagnetic) {
    return receive(127250, ms, {{"heading_rad", radians}, {"reference", reference}});
  }
  std::vector<SensorSample> tilt(std::int64_t ms, double roll, double pitch = 0) {
    return receive(127257, ms, {{"roll_rad", roll}, {"pitch_rad", pitch}});
  }
  std::vector<SensorSample> fix(std::int64_t ms, double method, double hdop, std::uint8_t source = 10) {
    return receive(129029, ms,
                   {{"latitude_deg", 10}, {"longitude_deg", 20}, {"method", method}, {"hdop", hdop}}, source,
                   43);
  }
  N2kSamples samples;
};

template <class T>
T only(const std::vector<SensorSample>& samples) {
  EXPECT_EQ(samples.size(), 1U);
  const T* found = samples.empty() ? nullptr : std::get_if<T>(&samples.front());
  EXPECT_NE(found, nullptr);
  return found == nullptr ? T{} : *found;
}

TEST(CanAttitude, RollAndPitchAreThoseOfTheHeadingsInstant) {
  Bus bus;
  EXPECT_TRUE(bus.tilt(0, 0.10, -0.02).empty());
  EXPECT_TRUE(bus.heading(25, 1.5).empty());
  const auto sample = only<AttitudeSample>(bus.tilt(100, 0.14, 0.02));
  EXPECT_EQ(sample.utc_ns, kFirstMessage_ns + 25 * kMillisecond_ns);
  EXPECT_NEAR(sample.roll, 0.11, 1e-9);
  EXPECT_NEAR(sample.pitch, -0.01, 1e-9);
  EXPECT_NEAR(sample.heading, 1.5, 1e-9);
  EXPECT_TRUE(sample.magnetic);
}

TEST(CanAttitude, AFastCompassGivesASampleForEachHeading) {
  Bus bus;
  bus.tilt(0, 0);
  for (int i = 1; i <= 5; ++i) EXPECT_TRUE(bus.heading(20 * i, 0.1 * i).empty());
  const auto samples = bus.tilt(120, 0.12);
  ASSERT_EQ(samples.size(), 5U);
  for (int i = 0; i < 5; ++i)
    EXPECT_NEAR(std::get<AttitudeSample>(samples[static_cast<std::size_t>(i)]).roll, 0.02 * (i + 1), 1e-9);
}

TEST(CanAttitude, MessagesOfOneSequenceIdentifierAreOneInstant) {
  Bus bus;
  const auto heading = [&](std::int64_t ms, double sid) {
    return bus.receive(127250, ms, {{"sid", sid}, {"heading_rad", 1}, {"reference", kTrue}});
  };
  const auto tilt = [&](std::int64_t ms, double sid, double roll) {
    return bus.receive(127257, ms, {{"sid", sid}, {"roll_rad", roll}, {"pitch_rad", 0}});
  };
  tilt(0, 1, 0.1);
  heading(1, 1);
  tilt(100, 2, 0.2);  // from here on it is known that the identifiers move
  const auto sample = only<AttitudeSample>(heading(101, 2));
  EXPECT_EQ(sample.utc_ns, kFirstMessage_ns + 100 * kMillisecond_ns);
  EXPECT_NEAR(sample.roll, 0.2, 1e-9);
  EXPECT_FALSE(sample.magnetic);
  // The heading first.
  EXPECT_TRUE(heading(200, 3).empty());
  const auto next = only<AttitudeSample>(tilt(201, 3, 0.3));
  EXPECT_EQ(next.utc_ns, kFirstMessage_ns + 200 * kMillisecond_ns);
  EXPECT_NEAR(next.roll, 0.3, 1e-9);
}

TEST(CanAttitude, AnIdentifierThatNeverMovesSaysNothing) {
  Bus bus;
  for (int i = 0; i < 3; ++i) {
    bus.receive(127257, 100 * i, {{"sid", 0}, {"roll_rad", 0.1 * i}, {"pitch_rad", 0}});
    EXPECT_TRUE(
        bus.receive(127250, 100 * i + 50, {{"sid", 0}, {"heading_rad", 1}, {"reference", 0}}).empty());
  }
  EXPECT_NEAR(only<AttitudeSample>(bus.tilt(300, 0.3)).roll, 0.25, 1e-9);
}

TEST(CanGyro, TheRateOfTurnIsThatOfTheHeadingToStarboard) {
  Bus bus;
  const auto sample = only<GyroSample>(bus.receive(127251, 25, {{"rate_of_turn_radps", -0.125}}));
  EXPECT_EQ(sample.utc_ns, kFirstMessage_ns + 25 * kMillisecond_ns);
  EXPECT_EQ(sample.heading_rate, -0.125);
  EXPECT_FALSE(sample.body_rate);
  EXPECT_TRUE(bus.receive(127251, 50, {{"sid", 3}}).empty());
  EXPECT_EQ(bus.samples.counts().incomplete, 1U);
}

TEST(CanAttitude, RollIsNotDrawnAcrossAGap) {
  Bus bus;
  bus.tilt(0, 0);
  bus.heading(100, 1);
  EXPECT_TRUE(bus.tilt(400, 0.4).empty());
  EXPECT_EQ(bus.samples.counts().unpaired_headings, 1U);
}

TEST(CanAttitude, RollIsInterpolatedOverTheSmallerTurnUpsideDown) {
  Bus bus;
  bus.tilt(0, 3.1);
  bus.heading(50, 1);
  EXPECT_NEAR(std::abs(only<AttitudeSample>(bus.tilt(100, -3.1)).roll), std::numbers::pi, 1e-9);
}

TEST(CanAttitude, HeadingsWithoutRollAreDroppedAndCounted) {
  Bus bus;
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(bus.heading(100 * i, 1).empty());
  EXPECT_EQ(bus.samples.counts().unpaired_headings, 20U - AttitudePairing::kWaiting);
}

TEST(CanAttitude, DeviationIsAddedAndVariationOnlyWhenWanted) {
  const std::vector<N2kValue> values = {
      {"heading_rad", 6.2}, {"deviation_rad", 0.1}, {"variation_rad", -0.3}, {"reference", kMagnetic}};
  for (const bool wanted : {false, true}) {
    N2kSamples::Config config;
    config.message_variation = wanted;
    Bus bus(config);
    bus.tilt(0, 0);
    bus.receive(127250, 50, values);
    const auto sample = only<AttitudeSample>(bus.tilt(100, 0));
    EXPECT_EQ(sample.magnetic, !wanted);
    EXPECT_NEAR(sample.heading, wanted ? 6.0 : 6.3 - 2 * std::numbers::pi, 1e-9);
  }
}

TEST(CanAttitude, AHeadingWithoutAReferenceIsNone) {
  Bus bus;
  bus.tilt(0, 0);
  bus.receive(127250, 50, {{"heading_rad", 1}});
  bus.receive(127250, 60, {{"reference", kTrue}});
  EXPECT_TRUE(bus.tilt(100, 0).empty());
  EXPECT_EQ(bus.samples.counts().incomplete, 2U);
}

TEST(CanDepth, ComesFromThePressureOfTheWaterAlone) {
  N2kSamples::Config config;
  config.latitude = 40 * kRadiansPerDegree;
  Bus bus(config);
  const auto pressure = [&](double source, double pascal) {
    return bus.receive(130314, 0, {{"source", source}, {"pressure_pa", pascal}});
  };
  EXPECT_TRUE(pressure(0, 98000).empty());  // of the air
  const double depth = only<DepthSample>(pressure(1, 101325 + 500'000)).depth;
  EXPECT_NEAR(depth, depthFromPressure(500'000, config.latitude), 1e-6);
  EXPECT_NEAR(depth, 49.6, 0.1);
  EXPECT_TRUE(bus.receive(128267, 0, {{"depth_m", 3}}).empty());
}

TEST(CanDepth, ComesFromTheFieldThatIsConfigured) {
  N2kSamples::Config config;
  config.depth_from = N2kSamples::DepthFrom::kOffset;
  Bus offset(config);
  EXPECT_EQ(only<DepthSample>(offset.receive(128267, 0, {{"depth_m", 3}, {"offset_m", 21.5}})).depth, 21.5);
  EXPECT_TRUE(offset.receive(128267, 0, {{"depth_m", 3}, {"offset_m", -0.4}}).empty());  // to the keel
  EXPECT_TRUE(offset.receive(128267, 0, {{"depth_m", 3}}).empty());
  EXPECT_TRUE(offset.receive(130314, 0, {{"source", 1}, {"pressure_pa", 200'000}}).empty());
  config.depth_from = N2kSamples::DepthFrom::kDepth;
  Bus field(config);
  EXPECT_EQ(only<DepthSample>(field.receive(128267, 0, {{"depth_m", 30}, {"offset_m", 1}})).depth, 30);
}

TEST(CanBattery, CurrentIsThatOutOfTheBatteryAndChargeIsTheNewest) {
  Bus bus;
  const auto charge = only<BatterySample>(
      bus.receive(127506, 0, {{"instance", 0}, {"dc_type", 0}, {"state_of_charge_percent", 83}}, 10, 11));
  EXPECT_EQ(charge.charge, 0.83);
  EXPECT_EQ(charge.voltage, std::nullopt);
  const auto status = only<BatterySample>(
      bus.receive(127508, 100, {{"instance", 0}, {"voltage_v", 25.61}, {"current_a", -7.5}}));
  EXPECT_NEAR(*status.voltage, 25.61, 1e-9);
  EXPECT_NEAR(*status.current, 7.5, 1e-9);
  EXPECT_EQ(status.charge, 0.83);
  // The next charge travels with the next status.
  EXPECT_TRUE(
      bus.receive(127506, 200, {{"instance", 0}, {"dc_type", 0}, {"state_of_charge_percent", 82}}, 10, 11)
          .empty());
  EXPECT_EQ(only<BatterySample>(bus.receive(127508, 300, {{"instance", 0}, {"voltage_v", 25.6}})).charge,
            0.82);
  // An old charge is none.
  EXPECT_EQ(only<BatterySample>(bus.receive(127508, 20'000, {{"instance", 0}, {"voltage_v", 25.6}})).charge,
            std::nullopt);
}

TEST(CanBattery, OtherBatteriesAndGeneratorsAreNotTheVehicles) {
  N2kSamples::Config config;
  config.battery_instance = 1;
  Bus bus(config);
  EXPECT_TRUE(bus.receive(127508, 0, {{"instance", 0}, {"voltage_v", 12}}).empty());
  EXPECT_TRUE(
      bus.receive(127506, 0, {{"instance", 1}, {"dc_type", 3}, {"state_of_charge_percent", 50}}, 10, 11)
          .empty());
  EXPECT_EQ(bus.receive(127508, 0, {{"instance", 1}, {"voltage_v", 12}}).size(), 1U);
}

TEST(CanGps, AFixHasTheSigmaOfItsGeometryAndPositionsBetweenFixesTakeIt) {
  Bus bus;
  const std::vector<N2kValue> position = {{"latitude_deg", 10.5}, {"longitude_deg", 20.5}};
  EXPECT_TRUE(bus.receive(129025, 0, position).empty());  // of unknown accuracy
  const auto fix = only<GpsFix>(bus.fix(100, 1, 1.4));
  EXPECT_NEAR(fix.latitude, 10 * kRadiansPerDegree, 1e-12);
  EXPECT_NEAR(fix.sigma_horizontal, 7, 1e-9);
  const auto rapid = only<GpsFix>(bus.receive(129025, 1000, position));
  EXPECT_NEAR(rapid.longitude, 20.5 * kRadiansPerDegree, 1e-9);
  EXPECT_NEAR(rapid.sigma_horizontal, 7, 1e-9);
  EXPECT_TRUE(bus.receive(129025, 3200, position).empty());
}

TEST(CanGps, PositionsThatWereNotMeasuredAreNoFixes) {
  Bus bus;
  for (const double method : {0, 6, 7, 8, 15}) EXPECT_TRUE(bus.fix(0, method, 1).empty()) << method;
  EXPECT_EQ(bus.fix(0, 1, 1).size(), 1U);
  // The receiver loses its fix: positions that it still sends are none.
  bus.fix(100, 0, 1);
  EXPECT_TRUE(bus.receive(129025, 200, {{"latitude_deg", 10}, {"longitude_deg", 20}}).empty());
}

TEST(CanWater, SoundSpeedNeedsTemperatureSalinityAndDepth) {
  Bus bus;
  const std::vector<N2kValue> sea = {{"source", 0}, {"temperature_c", 12.5}};
  auto water = only<WaterSample>(bus.receive(130312, 0, sea));
  EXPECT_NEAR(*water.temperature, 12.5, 1e-9);
  EXPECT_EQ(water.sound_speed, std::nullopt);
  bus.receive(130314, 100, {{"source", 1}, {"pressure_pa", 400'000}});
  EXPECT_EQ(only<WaterSample>(bus.receive(130316, 200, sea)).sound_speed, std::nullopt);
  water = only<WaterSample>(
      bus.receive(130321, 300, {{"salinity_ppt", 34.5}, {"water_temperature_c", 12.4}}, 10, 22));
  EXPECT_NEAR(*water.sound_speed, 1498.06, 0.05);
  EXPECT_NEAR(*only<WaterSample>(bus.receive(130312, 400, sea)).sound_speed, *water.sound_speed + 0.33, 0.1);
  EXPECT_EQ(water.conductivity, std::nullopt);
  // The temperature of a cabin is not the water's.
  EXPECT_TRUE(bus.receive(130312, 500, {{"source", 4}, {"temperature_c", 20}}).empty());
}

TEST(CanSources, TheFirstToSendIsSelectedUntilItIsSilent) {
  Bus bus;
  const auto depth = [&](std::int64_t ms, std::uint8_t source) {
    return bus.receive(130314, ms, {{"source", 1}, {"pressure_pa", 200'000}}, source).size();
  };
  EXPECT_EQ(depth(0, 5), 1U);
  EXPECT_EQ(depth(100, 6), 0U);
  EXPECT_EQ(depth(9'000, 5), 1U);
  EXPECT_EQ(depth(18'000, 6), 0U);
  EXPECT_EQ(depth(19'100, 6), 1U);
  EXPECT_EQ(depth(19'200, 5), 0U);
  EXPECT_EQ(bus.samples.counts().other_sources, 3U);
  EXPECT_EQ(bus.samples.counts().source_changes, 1U);
}

TEST(CanSources, AConfiguredAddressAloneIsSelected) {
  N2kSamples::Config config;
  config.depth_source = 6;
  Bus bus(config);
  EXPECT_EQ(bus.receive(130314, 0, {{"source", 1}, {"pressure_pa", 2e5}}, 5).size(), 0U);
  EXPECT_EQ(bus.receive(130314, 1'000'000, {{"source", 1}, {"pressure_pa", 2e5}}, 5).size(), 0U);
  EXPECT_EQ(bus.receive(130314, 1'000'001, {{"source", 1}, {"pressure_pa", 2e5}}, 6).size(), 1U);
}

TEST(CanSamples, ARealCaptureGivesPlausibleSamplesWithoutMemory) {
  FATHOM_REQUIRE_DATA("can/candumpSample3.txt");
  std::vector<CanFrame> frames;
  {
    ByteFile file(test::dataFile("can/candumpSample3.txt"));
    CanTextReader reader;
    std::vector<std::uint8_t> bytes(1 << 16);
    const auto keep = [&](const CanFrame& frame) { frames.push_back(frame); };
    while (const std::size_t got = file.read(bytes)) reader.feed({bytes.data(), got}, keep);
    reader.drain(keep);
  }
  N2kDecoder decoder;
  N2kSamples samples({});
  std::size_t attitudes = 0, fixes = 0, all = 0;
  bool plausible = true;
  const auto before = rt::threadCost();
  for (const CanFrame& frame : frames) {
    const N2kMessage* message = decoder.add(frame);
    if (message == nullptr) continue;
    for (const SensorSample& sample : samples.add(*message)) {
      ++all;
      if (const auto* a = std::get_if<AttitudeSample>(&sample)) {
        ++attitudes;
        plausible =
            plausible && a->heading >= 0 && a->heading < 2 * std::numbers::pi && std::abs(a->roll) < 0.6;
      } else if (const auto* g = std::get_if<GpsFix>(&sample)) {
        ++fixes;
        plausible = plausible && g->sigma_horizontal > 0 && g->sigma_horizontal < 100;
      }
    }
  }
  EXPECT_EQ((rt::threadCost() - before).heap_calls, 0U);
  EXPECT_TRUE(plausible);
  EXPECT_GT(all, 0U);
  RecordProperty("attitudes", static_cast<int>(attitudes));
  RecordProperty("fixes", static_cast<int>(fixes));
  EXPECT_EQ(samples.counts().samples, all);
  EXPECT_GT(attitudes + fixes, 10U);
}

}  // namespace
}  // namespace fathom::io
