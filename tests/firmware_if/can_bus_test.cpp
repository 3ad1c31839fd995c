// From the CAN socket to the samples, without an interface; tests/uml has the real one.
#include <gtest/gtest.h>
#include <linux/can/error.h>

#include <fstream>

#include "firmware_if/devices/can/bus/can_source.hpp"
#include "firmware_if/devices/can/bus/socket_can.hpp"
#include "firmware_if/devices/can/raw_can.hpp"
#include "firmware_if/devices/capture_commands.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

constexpr std::int64_t kVehicle = 1'700'000'000 * kSecond_ns;  // vehicle time
constexpr std::int64_t kSystem = kVehicle + 37 * kSecond_ns;   // the system's clock, off by 37 s

TEST(ReceiveTime, AFrameIsAsOldAsItsStampSays) {
  ReceiveTime time;
  time.drained(kSystem, kVehicle);
  EXPECT_EQ(time.toVehicle(kSystem + 20 * kMillisecond_ns, kSystem + 80 * kMillisecond_ns,
                           kVehicle + 80 * kMillisecond_ns),
            kVehicle + 20 * kMillisecond_ns);
  EXPECT_EQ(time.clockSteps(), 0U);
}

TEST(ReceiveTime, AFrameOfBeforeAStepIsReadByTheClockThatStampedIt) {
  for (const std::int64_t step : {3600 * kSecond_ns, -3600 * kSecond_ns, 5 * kSecond_ns}) {
    ReceiveTime time;
    time.drained(kSystem, kVehicle);
    const std::int64_t now = 80 * kMillisecond_ns;
    EXPECT_EQ(time.toVehicle(kSystem + 20 * kMillisecond_ns, kSystem + step + now, kVehicle + now),
              kVehicle + 20 * kMillisecond_ns);
    // And one that came after it, in the same queue.
    EXPECT_EQ(time.toVehicle(kSystem + step + 70 * kMillisecond_ns, kSystem + step + now, kVehicle + now),
              kVehicle + 70 * kMillisecond_ns);
    time.drained(kSystem + step + now, kVehicle + now);
    EXPECT_EQ(time.clockSteps(), 1U);
    time.drained(kSystem + step + 2 * now, kVehicle + 2 * now);
    EXPECT_EQ(time.clockSteps(), 1U);
  }
}

TEST(ReceiveTime, AStampWithoutSenseIsThePresent) {
  ReceiveTime time;
  time.drained(kSystem, kVehicle);
  EXPECT_EQ(time.toVehicle(0, kSystem + kMillisecond_ns, kVehicle + kMillisecond_ns),
            kVehicle + kMillisecond_ns);
  EXPECT_EQ(time.toVehicle(kSystem + 9 * kSecond_ns, kSystem + kMillisecond_ns, kVehicle + kMillisecond_ns),
            kVehicle + kMillisecond_ns);
}

TEST(ReceiveTime, AClockThatIsSlewedDoesNotStep) {
  ReceiveTime time;
  // 0.5 ms a second, as adjtime does, looked at every 10 s.
  for (int i = 0; i < 100; ++i)
    time.drained(kSystem + i * (10 * kSecond_ns + 5 * kMillisecond_ns), kVehicle + i * 10 * kSecond_ns);
  EXPECT_EQ(time.clockSteps(), 0U);
}

TEST(CanErrors, EveryKindIsCountedByItself) {
  CanErrors errors;
  const std::vector<std::uint8_t> none(8, 0);
  const auto controller = [&](std::uint8_t what) {
    std::vector<std::uint8_t> data(8, 0);
    data[1] = what;
    errors.add(CAN_ERR_CRTL, data);
  };
  errors.add(CAN_ERR_TX_TIMEOUT, none);
  errors.add(CAN_ERR_LOSTARB, none);
  controller(CAN_ERR_CRTL_RX_OVERFLOW);
  controller(CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING);
  controller(CAN_ERR_CRTL_RX_PASSIVE);
  errors.add(CAN_ERR_PROT, none);
  errors.add(CAN_ERR_TRX, none);
  errors.add(CAN_ERR_ACK, none);
  errors.add(CAN_ERR_BUSERROR, none);
  errors.add(CAN_ERR_BUSOFF, none);
  EXPECT_TRUE(errors.busOff());
  errors.add(CAN_ERR_RESTARTED, none);
  EXPECT_FALSE(errors.busOff());
  for (std::uint8_t kind = 0; kind < CanErrors::kKinds; ++kind)
    EXPECT_EQ(errors.count(static_cast<CanErrors::Kind>(kind)), 1U)
        << CanErrors::name(static_cast<CanErrors::Kind>(kind));
  EXPECT_EQ(errors.frames(), 11U);
}

TEST(CanErrors, ADataFrameShowsThatTheBusIsBack) {
  CanErrors errors;
  errors.add(CAN_ERR_BUSOFF, {});
  errors.alive();
  EXPECT_FALSE(errors.busOff());
  // A frame that lacks its bytes counts by its class alone.
  errors.add(CAN_ERR_CRTL, {});
  EXPECT_EQ(errors.count(CanErrors::kErrorPassive), 0U);
}

TEST(RawCan, RecordsReadBackAsTheyWere) {
  RawCanWriter writer;
  std::vector<CanFrame> frames;
  for (std::uint8_t size = 0; size <= 8; ++size) {
    CanFrame frame{.utc_ns = {}, .id = 0x1FFFFFFFU - size, .size = size};
    for (std::uint8_t i = 0; i < size; ++i) frame.data[i] = static_cast<std::uint8_t>(0xF0 + i);
    frame.utc_ns = kVehicle + size * 1'234'000;
    frames.push_back(frame);
    ASSERT_TRUE(writer.add(frame, size == 4));
  }
  auto bytes = writer.bytes();
  EXPECT_EQ(bytes.size(), 9U * 8 + 36);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    RawCanRecord record;
    ASSERT_TRUE(readRawCan(bytes, writer.arrivalNs(), record));
    EXPECT_EQ(record.frame.id, frames[i].id);
    EXPECT_EQ(record.frame.utc_ns, frames[i].utc_ns);
    EXPECT_EQ(record.frame.size, frames[i].size);
    EXPECT_EQ(record.frame.data, frames[i].data);
    EXPECT_EQ(record.error, i == 4);
  }
  EXPECT_TRUE(bytes.empty());
}

TEST(RawCan, IsFullEmptyAndEmptiedAsItSays) {
  RawCanWriter writer;
  EXPECT_TRUE(writer.bytes().empty());
  CanFrame frame;
  EXPECT_FALSE(writer.add(frame, false));  // has no time
  frame.utc_ns = kVehicle;
  for (std::size_t i = 0; i < RawCanWriter::kFrames; ++i) ASSERT_TRUE(writer.add(frame, false));
  EXPECT_FALSE(writer.add(frame, false));
  writer.clear();
  EXPECT_TRUE(writer.add(frame, false));
}

TEST(RawCan, DamageEndsTheReading) {
  const std::vector<std::uint8_t> long_frame = {1, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  const std::vector<std::uint8_t> cut = {1, 0, 0, 0, 0, 0, 0, 3, 0, 0};
  const std::vector<std::uint8_t> flag = {1, 0, 0, 0x80, 0, 0, 0, 0};
  for (const auto& bad : {long_frame, cut, flag}) {
    std::span<const std::uint8_t> bytes = bad;
    RawCanRecord record;
    EXPECT_FALSE(readRawCan(bytes, kVehicle, record));
    EXPECT_EQ(bytes.size(), bad.size());
  }
}

TEST(RawCan, TheMissionsLogIsDecodedAsACaptureIs) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "sensors.lcmlog";
  {
    LogEventWriter log(path);
    RawCanWriter writer;
    CanFrame frame{.utc_ns = kVehicle,
                   .id = 0x09F112CC,
                   .size = 8,
                   .data = {0xFF, 0x72, 0x5A, 0xFF, 0x7F, 0xFF, 0x7F, 0xFD}};
    ASSERT_TRUE(writer.add(frame, false));
    ASSERT_TRUE(writer.add(frame, true));
    log.write(kVehicle / 1000, "RAW_DVL", encodeRaw(kVehicle, writer.bytes()));
    log.write(kVehicle / 1000, "RAW_CAN", encodeRaw(kVehicle, writer.bytes()));
    log.write(kVehicle / 1000, "RAW_CAN", encodeRaw(kVehicle, writer.bytes().first(9)));
  }
  const std::filesystem::path out = folder.path() / "out", report = folder.path() / "report";
  const auto run = [&](const std::filesystem::path& file) {
    std::FILE* messages = std::fopen(out.c_str(), "w");
    std::FILE* counts = std::fopen(report.c_str(), "w");
    const int status = runCanCommand({file, true}, messages, counts);
    std::fclose(messages);
    std::fclose(counts);
    return status;
  };
  EXPECT_EQ(run(path), 0);
  std::string line, counts;
  std::ifstream messages(out);
  ASSERT_TRUE(std::getline(messages, line));
  EXPECT_NE(line.find(R"("pgn":127250,"source":204,"fields":{"heading_rad":2.3154)"), std::string::npos)
      << line;
  EXPECT_FALSE(std::getline(messages, line));
  std::ifstream reported(report);
  std::getline(reported, counts);
  EXPECT_NE(counts.find(
                "frames 1, whole messages 0, messages 1, without decoder 0, other frames 1, broken lines 1"),
            std::string::npos)
      << counts;
}

TEST(CanConfig, EveryKeyIsRead) {
  const ConfigTable table = ConfigTable::parse(R"(
[can]
interface = "can1"
heading_address = 35
attitude_address = 36
depth_address = 40
battery_address = 41
gps_address = 42
water_address = 43
switch_after_s = 4.5
attitude_gap_s = 0.5
variation = "message"
depth_source = "offset"
surface_pressure_pa = 0
water_density_kgpm3 = 1000
battery_instance = 2
gps_range_sigma_m = 3
salinity_psu = 35.5
[can.send]
enabled = true
address = 7
unique_number = 77
manufacturer_code = 1234
device_instance = 3
status_pgn = 130999
position_period_s = 0.1
fix_period_s = 0
depth_period_s = 2
status_period_s = 10
frames_per_s = 50
)",
                                               "onboard.toml");
  const CanConfig can = readKeys(table.table("can"), CanConfig{}, visitCan);
  table.finish();
  EXPECT_EQ(can.interface, "can1");
  EXPECT_EQ(can.samples.heading_source, 35);
  EXPECT_EQ(can.samples.attitude_source, 36);
  EXPECT_EQ(can.samples.depth_source, 40);
  EXPECT_EQ(can.samples.battery_source, 41);
  EXPECT_EQ(can.samples.gps_source, 42);
  EXPECT_EQ(can.samples.water_source, 43);
  EXPECT_EQ(can.samples.switch_after_s, 4.5);
  EXPECT_EQ(can.samples.attitude_gap_s, 0.5);
  EXPECT_TRUE(can.samples.message_variation);
  EXPECT_EQ(can.samples.depth_from, N2kSamples::DepthFrom::kOffset);
  EXPECT_EQ(can.samples.surface_pressure_pa, 0);
  EXPECT_EQ(can.samples.water_density, 1000);
  EXPECT_EQ(can.samples.battery_instance, 2);
  EXPECT_EQ(can.samples.gps_range_sigma_m, 3);
  EXPECT_EQ(can.samples.salinity_psu, 35.5);
  EXPECT_TRUE(can.send);
  EXPECT_EQ(can.sender.address, 7);
  EXPECT_EQ(can.sender.name.unique_number, 77U);
  EXPECT_EQ(can.sender.name.manufacturer_code, 1234);
  EXPECT_EQ(can.sender.name.device_instance, 3);
  EXPECT_EQ(can.sender.status_pgn, 130999U);
  EXPECT_EQ(can.sender.position_period_s, 0.1);
  EXPECT_EQ(can.sender.fix_period_s, 0);
  EXPECT_EQ(can.sender.depth_period_s, 2);
  EXPECT_EQ(can.sender.status_period_s, 10);
  EXPECT_EQ(can.sender.frames_per_s, 50);
  EXPECT_NO_THROW(can.samples.validate());
  EXPECT_NO_THROW(can.sender.validate());
}

TEST(CanConfig, AnAbsentTableTakesTheDefaults) {
  const ConfigTable table = ConfigTable::parse("", "onboard.toml");
  const CanConfig can = readKeys(table.table("can"), CanConfig{}, visitCan);
  table.finish();
  EXPECT_EQ(can.interface, "");
  EXPECT_FALSE(can.send);
  EXPECT_EQ(can.samples.heading_source, std::nullopt);
  EXPECT_EQ(can.samples.salinity_psu, std::nullopt);
}

TEST(CanConfig, ValuesThatMakeNoSenseAreRefused) {
  for (const char* bad : {"heading_address = 252", "depth_source = \"sonar\"", "water_density_kgpm3 = 500",
                          "interface = 3", "send.address = 252", "send.position_period_s = 0.05",
                          "send.status_pgn = 129025", "send.manufacturer_code = 2047"}) {
    const ConfigTable table = ConfigTable::parse(bad, "onboard.toml");
    EXPECT_THROW(static_cast<void>(readKeys(table, CanConfig{}, visitCan)), InputError) << bad;
  }
}

TEST(CanSource, WithoutAnInterfaceItWaitsAndSaysSo) {
  struct Nothing final : SampleSink {
    void sample(std::int64_t, const SensorSample&) noexcept override { ADD_FAILURE(); }
    void raw(std::int64_t, std::string_view, std::span<const std::uint8_t>) noexcept override {
      ADD_FAILURE();
    }
  } sink;
  rt::RealClock clock;
  CanConfig config{.interface = "can-absent", .samples = {}, .send = true, .sender = {}};
  CanSource source(config, clock);
  const std::int64_t before = clock.monotonicNs();
  EXPECT_FALSE(source.poll(20, sink));
  EXPECT_GE(clock.monotonicNs() - before, 19 * kMillisecond_ns);
  EXPECT_FALSE(source.health().open);
  for (const char* name : {"", "can 0", "an-interface-with-a-long-name", "a/b"}) {
    config.interface = name;
    EXPECT_THROW(CanSource(config, clock), InputError) << name;
  }
}

}  // namespace
}  // namespace fathom::io
