#include "firmware_if/mission/sensor_log.hpp"

#include <gmock/gmock.h>
#include <lcm/lcm-cpp.hpp>

#include <random>

#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "tests/firmware_if/sample_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using test::everyKindOfSample, test::readText, test::refusal, test::same, test::writeText;
using ::testing::HasSubstr;

constexpr std::int64_t kArrival = 1'700'000'000'200'000'001;

class SensorLogTest : public ::testing::Test {
 protected:
  void record(const std::string& vehicle_name = "") const {
    SensorLogWriter writer(path_, vehicle_name);
    std::int64_t arrival = kArrival;
    for (const SensorSample& sample : everyKindOfSample()) writer.write(arrival++, sample);
    writer.flush();
  }
  // Reads all; each sample must be one that was recorded, in order.
  struct Read {
    std::size_t samples = 0;
    std::uint64_t skipped = 0, damaged = 0;
    bool in_order = true;
  };
  [[nodiscard]] Read readAll() const {
    const std::vector<SensorSample> recorded = everyKindOfSample();
    SensorLogReader reader(folder_.path());
    Read read;
    std::size_t at = 0;
    while (const auto entry = reader.next()) {
      while (at < recorded.size() && !same(recorded[at], entry->sample)) ++at;
      if (at == recorded.size() || entry->arrival_utc_ns != kArrival + static_cast<std::int64_t>(at))
        read.in_order = false;
      ++read.samples;
    }
    read.skipped = reader.skippedEntries();
    read.damaged = reader.damagedEntries();
    return read;
  }
  // Offsets at which the events of the log end, the first being 0.
  [[nodiscard]] std::vector<std::size_t> eventEnds() const {
    std::vector<std::size_t> ends = {0};
    LogEventReader reader(path_);
    LogEvent event;
    while (reader.next(event)) ends.push_back(reader.endOfLastEvent());
    return ends;
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_.path() / "sensors.lcmlog";
};

TEST_F(SensorLogTest, EverySampleComesBackToTheNanosecondAndTheBit) {
  record("sirius");
  const Read read = readAll();
  EXPECT_EQ(read.samples, everyKindOfSample().size());
  EXPECT_TRUE(read.in_order);
  EXPECT_EQ(read.skipped, 0u);
  EXPECT_EQ(read.damaged, 0u);
}

TEST_F(SensorLogTest, ALogCutAnywhereReadsUpToItsLastWholeEntry) {
  record();
  const std::string whole = readText(path_);
  const std::vector<std::size_t> ends = eventEnds();
  ASSERT_EQ(ends.size(), everyKindOfSample().size() + 1);
  for (std::size_t size = ends[1]; size < whole.size(); ++size) {
    writeText(path_, whole.substr(0, size));
    const Read read = readAll();
    const auto entries =
        static_cast<std::size_t>(std::upper_bound(ends.begin(), ends.end(), size) - ends.begin()) - 1;
    ASSERT_EQ(read.samples, entries) << "cut at " << size;
    ASSERT_TRUE(read.in_order);
    ASSERT_EQ(read.damaged, size == ends[entries] ? 0u : 1u) << "cut at " << size;
  }
}

TEST_F(SensorLogTest, DamageInTheMiddleCostsOnlyTheEntriesThatItTouches) {
  record();
  const std::string whole = readText(path_);
  const std::vector<std::size_t> ends = eventEnds();
  const std::size_t all = everyKindOfSample().size();
  // An event's number and time stamp [bytes 4 to 20) say nothing that the message does not say under its CRC.
  const auto harmless = [&](std::size_t first, std::size_t last) {
    const std::size_t begin = *std::prev(std::upper_bound(ends.begin(), ends.end(), first));
    return first >= begin + 4 && last < begin + 20;
  };
  std::mt19937 random(11);
  for (int i = 0; i < 400; ++i) {
    std::string damaged = whole;
    const std::size_t at = random() % whole.size(), last = std::min(at + random() % 8, whole.size() - 1);
    for (std::size_t k = at; k <= last; ++k) damaged[k] = static_cast<char>(~damaged[k]);
    writeText(path_, damaged);
    const Read read = readAll();
    EXPECT_TRUE(read.in_order) << "damage at " << at << " was taken for a measurement";
    if (harmless(at, last)) {
      EXPECT_EQ(read.samples, all);
      continue;
    }
    EXPECT_GE(read.samples, all - 2) << "damage at " << at;
    EXPECT_LT(read.samples, all) << "damage at " << at << " was not found";
    EXPECT_GE(read.damaged + read.skipped, 1u) << "damage at " << at;
  }
}

TEST_F(SensorLogTest, RemovedAndInsertedStretchesAreSkippedAndCountedOnce) {
  record();
  const std::string whole = readText(path_);
  const std::vector<std::size_t> ends = eventEnds();
  std::string text = whole;
  text.erase(ends[3] + 10, 5);
  writeText(path_, text);
  EXPECT_EQ(readAll().samples, everyKindOfSample().size() - 1);
  EXPECT_EQ(readAll().damaged, 1u);
  text = whole;
  text.insert(ends[3], std::string(100'000, '\xed'));
  writeText(path_, text);
  EXPECT_EQ(readAll().samples, everyKindOfSample().size());
  EXPECT_EQ(readAll().damaged, 1u);
}

TEST_F(SensorLogTest, ALogIsContinuedBehindItsLastWholeEntry) {
  record();
  const std::string whole = readText(path_);
  writeText(path_, whole.substr(0, whole.size() - 3));
  {
    SensorLogWriter writer(path_);
    writer.write(kArrival + static_cast<std::int64_t>(everyKindOfSample().size()) - 1,
                 everyKindOfSample().back());
  }
  EXPECT_EQ(readText(path_), whole);
}

TEST_F(SensorLogTest, AFileThatIsNoLogIsNeverOverwritten) {
  writeText(path_, "somebody's thesis");
  EXPECT_THAT(refusal([&] { SensorLogWriter writer(path_); }), HasSubstr("is no LCM event log"));
  EXPECT_EQ(readText(path_), "somebody's thesis");
  EXPECT_THAT(refusal([&] { SensorLogWriter writer("/nowhere/sensors.lcmlog"); }),
              HasSubstr("cannot be written"));
}

TEST_F(SensorLogTest, LcmsOwnToolsReadTheLogAndItsAcfrChannels) {
  record("sirius");
  lcm::LogFile log(path_.string(), "r");
  ASSERT_TRUE(log.good());
  std::map<std::string, int> channels;
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    ++channels[event->channel];
    EXPECT_EQ(event->timestamp / 1000, kArrival / 1'000'000);
  }
  EXPECT_EQ(channels["RDI"], 2);
  EXPECT_EQ(channels["TCM"], 1);  // the other heading is true, which a TCM never gives
  EXPECT_EQ(channels["PAROSCI"], 1);
  EXPECT_EQ(channels["USBL_FIX.sirius"], 1);
  EXPECT_EQ(channels["ACFR_AUV_VIS_RAWLOG"], 2);
  EXPECT_EQ(channels["FATHOM_WATER"], 2);
}

TEST_F(SensorLogTest, ALogOfAnAcfrVehicleIsReadByItsOwnChannels) {
  {
    lcm::LogFile log(path_.string(), "w");
    for (const SensorSample& sample : everyKindOfSample()) {
      auto message = encodeAcfrTwin(sample, "sirius");
      if (!message) continue;
      lcm::LogEvent event;
      event.timestamp = kArrival / 1000;
      event.channel = message->channel;
      event.datalen = static_cast<int>(message->data.size());
      event.data = message->data.data();
      ASSERT_EQ(log.writeEvent(&event), 0);
    }
  }
  SensorLogReader reader(folder_.path());
  const auto attitude = reader.next();
  ASSERT_TRUE(attitude);
  EXPECT_EQ(attitude->arrival_utc_ns, kArrival / 1000 * 1000);
  EXPECT_TRUE(same(attitude->sample, AttitudeSample{1'700'000'000'123'456'000, 0.01, -0.02, 6.1, true}));
  const auto depth = reader.next();
  ASSERT_TRUE(depth);
  EXPECT_TRUE(same(depth->sample, DepthSample{1'700'000'000'123'456'000, 23.456}));
  const auto fix = reader.next();
  ASSERT_TRUE(fix);
  EXPECT_EQ(std::get<UsblFix>(fix->sample).sigma_horizontal, 0.35);
  const auto image = reader.next();
  ASSERT_TRUE(image);
  EXPECT_TRUE(same(image->sample, ImageEvent{1'700'000'000'123'456'000, CameraSide::kLeft,
                                             "PR_20231114_221320_123_LC16.tif", 0.002}));
  EXPECT_TRUE(reader.next());
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.damagedEntries(), 0u);
}

TEST_F(SensorLogTest, RawBytesAreBesideTheSamplesAndComeBack) {
  const std::vector<std::uint8_t> ensemble = {0x7f, 0x7f, 0xed, 0xa1, 0xda, 0x01, 0, 0, 0};
  {
    LogEventWriter writer(path_);
    const LogMessage sample = encodeSample(kArrival, everyKindOfSample()[0]);
    writer.write(1, "RAW_DVL", encodeRaw(kArrival, ensemble));
    writer.write(1, sample.channel, sample.data);
    writer.write(2, "RAW_MODEM", encodeRaw(kArrival + 1, {}));
  }
  EXPECT_EQ(readAll().skipped, 2u);
  LogEventReader events(path_);
  LogEvent event;
  ASSERT_TRUE(events.next(event));
  EXPECT_EQ(event.channel, "RAW_DVL");
  const auto raw = decodeRaw(event.data);
  ASSERT_TRUE(raw);
  EXPECT_EQ(raw->arrival_utc_ns, kArrival);
  EXPECT_TRUE(std::equal(raw->bytes.begin(), raw->bytes.end(), ensemble.begin(), ensemble.end()));
  ASSERT_TRUE(events.next(event));
  ASSERT_TRUE(events.next(event));
  const auto none = decodeRaw(event.data);
  ASSERT_TRUE(none);
  EXPECT_TRUE(none->bytes.empty());
}

TEST_F(SensorLogTest, AnImageOutsideItsFolderIsDamageNotAPath) {
  {
    SensorLogWriter writer(path_);
    writer.write(kArrival, everyKindOfSample()[0]);
    writer.write(kArrival, ImageEvent{1, CameraSide::kLeft, "../../etc/passwd", 0});
  }
  EXPECT_EQ(readAll().samples, 1u);
  EXPECT_EQ(readAll().damaged, 1u);
}

TEST_F(SensorLogTest, FoldersWithoutNavigationAreRefused) {
  const auto refused = [&] { return refusal([&] { SensorLogReader reader(folder_.path()); }); };
  EXPECT_THAT(refused(), HasSubstr("has neither sensors.lcmlog nor"));
  writeText(path_, "");
  EXPECT_THAT(refused(), HasSubstr("sensors.lcmlog: is empty"));
  writeText(path_, std::string(100'000, '\x01'));
  EXPECT_THAT(refused(), HasSubstr("holds no sample"));
  std::filesystem::remove(path_);
  std::filesystem::create_directory(path_);
  EXPECT_THAT(refused(), HasSubstr("cannot be read"));
}

}  // namespace
}  // namespace fathom::io
