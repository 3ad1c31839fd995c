// The recorder's parts, each alone.
#include <gmock/gmock.h>

#include <numeric>
#include <random>
#include <thread>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/recorder/image_stage.hpp"
#include "firmware_if/recorder/log_stage.hpp"
#include "firmware_if/recorder/recorder_config.hpp"
#include "firmware_if/recorder/recording_folder.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::io {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes sequence(std::size_t size, unsigned first) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), static_cast<std::uint8_t>(first));
  return bytes;
}

TEST(RawTiff, ReadsBackToThePixelInEveryFormatAndSize) {
  const test::TemporaryFolder folder;
  ImageWriter writer(folder.path());
  int number = 0;
  for (const PixelFormat format : {PixelFormat::kMono, PixelFormat::kBayerRggb, PixelFormat::kRgb}) {
    for (const int bits : {8, 12, 16}) {
      for (const auto& [width, height] :
           {std::pair(1, 1), std::pair(7, 65), std::pair(33, 64), std::pair(3, 20000)}) {
        ImageView view{.width = width, .height = height, .format = format, .bits = bits};
        const std::size_t row = rowBytes(view), gap = 5;
        std::mt19937 random(static_cast<unsigned>(++number));
        Bytes memory((row + gap) * static_cast<std::size_t>(height));
        for (std::size_t i = 0; i < memory.size(); ++i)
          memory[i] =
              static_cast<std::uint8_t>(random()) & (bits == 12 && (i % (row + gap)) % 2 == 1 ? 0x0f : 0xff);
        view.data = memory.data();
        view.stride = row + gap;
        const std::string name = std::to_string(number) + ".tif";
        ASSERT_TRUE(writer.write(name, view));
        ASSERT_TRUE(writer.commit());
        EXPECT_EQ(std::filesystem::file_size(folder.path() / name), tiffBytes(view));
        const ImageFile read = readImage(folder.path() / name, format, bits, width, height);
        for (int y = 0; y < height; ++y)
          ASSERT_EQ(std::memcmp(read.bytes.data() + static_cast<std::size_t>(y) * row,
                                memory.data() + static_cast<std::size_t>(y) * view.stride, row),
                    0)
              << name << " row " << y;
      }
    }
  }
}

TEST(ImageWriter, GivesANameOnlyToWholeImagesAndNeverTwice) {
  const test::TemporaryFolder folder;
  const Bytes pixels(64, 9);
  const ImageView view{pixels.data(), 8, 8, 8, PixelFormat::kMono, 8};
  {
    ImageWriter writer(folder.path());
    ASSERT_TRUE(writer.write("a.tif", view));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "a.tif"));
    ASSERT_TRUE(writer.commit());
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "a.tif"));
    EXPECT_FALSE(writer.write("a.tif", view));
    ASSERT_TRUE(writer.write("b.tif", view));
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "b.tif"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "b.tif.tmp"));
  // The folder may come later.
  ImageWriter writer(folder.path() / "none");
  EXPECT_FALSE(writer.write("a.tif", view));
  EXPECT_EQ(writer.error(), ENOENT);
  std::filesystem::create_directory(folder.path() / "none");
  EXPECT_TRUE(writer.write("a.tif", view));
}

TEST(ByteRing, KeepsRecordsWholeAroundItsEnd) {
  ByteRing ring(4096);
  EXPECT_TRUE(ring.front().empty());
  for (unsigned round = 0; round < 200; ++round) {
    const Bytes a = sequence(700 + round, round), b = sequence(round % 7, round);
    ASSERT_TRUE(ring.push({a, b}));
    ASSERT_TRUE(ring.push({b, a}));
    Bytes expected = a;
    expected.insert(expected.end(), b.begin(), b.end());
    EXPECT_TRUE(std::ranges::equal(ring.front(), expected));
    ring.pop();
    EXPECT_EQ(ring.front().size(), a.size() + b.size());
    ring.pop();
  }
  EXPECT_TRUE(ring.front().empty());
  EXPECT_EQ(ring.refused(), 0u);
}

TEST(ByteRing, RefusesWhatDoesNotFitAndCountsIt) {
  ByteRing ring(4096);
  const Bytes large = sequence(1025, 0), fits = sequence(1000, 0);
  EXPECT_FALSE(ring.push({large}));
  int pushed = 0;
  while (ring.push({fits})) ++pushed;
  EXPECT_EQ(pushed, 4);
  EXPECT_EQ(ring.refused(), 2u);
  EXPECT_GT(ring.highWater(), 4000u);
  (void)ring.front();
  ring.pop();
  EXPECT_TRUE(ring.push({fits}));
}

TEST(ByteRing, GivesEveryRecordInOrderFromOneThreadToAnother) {
  ByteRing ring(4096);
  constexpr unsigned kRecords = 50000;
  std::thread producer([&] {
    for (unsigned n = 0; n < kRecords; ++n) {
      const Bytes record = sequence(1 + n % 300, n);
      while (!ring.push({record})) std::this_thread::yield();
    }
  });
  unsigned wrong = 0;
  for (unsigned n = 0; n < kRecords; ++n) {
    while (ring.front().empty()) std::this_thread::yield();
    wrong += std::ranges::equal(ring.front(), sequence(1 + n % 300, n)) ? 0 : 1;
    ring.pop();
  }
  producer.join();
  EXPECT_EQ(wrong, 0u);
}

TEST(DiskGuard, TakesStepsDownAtOnceAndBackUpWithSomeRoomToSpare) {
  using Level = DiskGuard::Level;
  DiskGuard guard(1000, 100);
  EXPECT_EQ(guard.update(1000), Level::kRoom);
  EXPECT_EQ(guard.update(999), Level::kImagesStopped);
  EXPECT_EQ(guard.update(1100), Level::kImagesStopped);
  EXPECT_EQ(guard.update(99), Level::kRawStopped);
  EXPECT_EQ(guard.update(110), Level::kRawStopped);
  EXPECT_EQ(guard.update(113), Level::kImagesStopped);
  EXPECT_EQ(guard.update(1126), Level::kRoom);
  EXPECT_EQ(guard.update(0), Level::kRawStopped);
  EXPECT_EQ(guard.update(5000), Level::kRoom);
}

TEST(ImageLane, KnowsTheOutcomeOfEachExposureAndWhichNoInputNamed) {
  ImageLane lane(2);
  CameraFrame frame;
  for (const std::int64_t utc_ns : {10, 20}) {
    frame.utc_ns = utc_ns;
    EXPECT_TRUE(lane.offer(frame));
  }
  EXPECT_FALSE(lane.offer(frame));
  EXPECT_EQ(lane.refused(), 1u);
  EXPECT_EQ(lane.stateOf(20), ImageLane::State::kWaiting);
  while (lane.take(frame)) EXPECT_FALSE(lane.settle(frame.utc_ns, true));
  EXPECT_FALSE(lane.settle(30, false));
  EXPECT_EQ(lane.stateOf(20), ImageLane::State::kWritten);
  EXPECT_EQ(lane.stateOf(30), ImageLane::State::kLost);
  EXPECT_EQ(lane.stateOf(40), ImageLane::State::kLost);
  EXPECT_EQ(lane.forget(20), 1u);
  EXPECT_EQ(lane.forget(40), 0u);
  EXPECT_EQ(lane.forget(30), 0u);
}

TEST(JournalFile, ContinuesTheNumbersAndIsOneLogToEveryReader) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "sensors.lcmlog";
  const Bytes data = sequence(100000, 1);
  for (int run = 0; run < 3; ++run) {
    JournalFile journal;
    ASSERT_TRUE(journal.open(path, 0, 0));
    for (int i = 0; i < 10; ++i) journal.append(run * 10 + i, "CHANNEL", data);
    EXPECT_FALSE(journal.safe());
    EXPECT_TRUE(journal.write());
    EXPECT_FALSE(journal.safe());
    EXPECT_TRUE(journal.sync());
    EXPECT_TRUE(journal.safe());
    journal.append(99, "LOST", data);  // in memory only
  }
  LogEventReader log(path);
  LogEvent event;
  std::int64_t next = 0;
  for (; log.next(event); ++next) {
    EXPECT_EQ(event.number, next);
    EXPECT_EQ(event.timestamp_us, next);
    EXPECT_EQ(event.data.size(), data.size());
  }
  EXPECT_EQ(next, 30);
  EXPECT_EQ(log.damagedStretches(), 0u);
}

TEST(LogEnd, IsFoundBehindTheLastWholeEventWhateverFollows) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "log";
  {
    LogEventWriter writer(path);
    for (int i = 0; i < 3000; ++i) writer.write(i, "CHANNEL", sequence(300, static_cast<unsigned>(i)));
  }
  const std::string whole = test::readText(path);
  for (const std::string& tail : {std::string(), std::string(700000, '\0'),
                                  std::string("\xED\xA1\xDA\x01\0\0", 6), whole.substr(0, 200)}) {
    test::writeText(path, whole + tail);
    const LogEnd end = findLogEnd(path);
    EXPECT_EQ(end.offset, whole.size());
    EXPECT_EQ(end.next_number, 3000);
  }
  test::writeText(path, std::string(5000, 'x'));
  EXPECT_EQ(findLogEnd(path).offset, 0u);
}

TEST(RecordingGap, IsReadBackAndDamageIsNot) {
  const RecordingGap gap{1234567890123, RecordingGap::Kind::kImage, 3, "PR_20231114_221320_123_LC16.tif"};
  LogMessage message = encodeGap(gap);
  const auto read = decodeGap(message.data);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->arrival_utc_ns, gap.arrival_utc_ns);
  EXPECT_EQ(read->kind, gap.kind);
  EXPECT_EQ(read->count, 3u);
  EXPECT_EQ(read->what, gap.what);
  for (std::size_t i = 0; i < message.data.size(); ++i) {
    message.data[i] ^= 0x10;
    EXPECT_FALSE(decodeGap(message.data)) << i;
    message.data[i] ^= 0x10;
    EXPECT_FALSE(decodeGap(std::span(message.data).first(i)));
  }
}

TEST(RecorderConfig, IsReadWithBoundsAndRefusesReservesInTheWrongOrder) {
  const ConfigTable table = ConfigTable::parse(
      "sync_interval_s = 0.25\nplanned_hours = 3\nimage_reserve_mib = 100\nlog_reserve_mib = 10\n"
      "image_queue = 3\nraw_queue_kib = 64\nacfr_channels = false\n",
      "onboard.toml");
  const RecorderConfig config = readKeys(table, RecorderConfig{}, visitRecorder);
  table.finish();
  EXPECT_EQ(config.sync_interval_s, 0.25);
  EXPECT_EQ(config.planned_hours, 3);
  EXPECT_EQ(config.image_queue, 3u);
  EXPECT_EQ(config.raw_queue_kib, 64u);
  EXPECT_FALSE(config.acfr_channels);
  for (const char* bad :
       {"sync_interval_s = 1.5", "image_queue = 0", "image_reserve_mib = 10\nlog_reserve_mib = 20"})
    EXPECT_THAT(test::refusal([&] {
                  (void)readKeys(ConfigTable::parse(bad, "onboard.toml"), RecorderConfig{}, visitRecorder);
                }),
                ::testing::HasSubstr("onboard.toml"))
        << bad;
}

TEST(PlannedRoom, CountsEveryImageAndWarnsWhenTheDiskIsTooSmall) {
  MissionConfig mission;
  mission.cameras.bits = 12;
  mission.cameras.rate_hz = 2;
  StereoRig rig;
  for (Camera* camera : {&rig.left, &rig.right}) {
    camera->width = 1360;
    camera->height = 1024;
  }
  RecorderConfig config{.planned_hours = 5};
  EXPECT_EQ(plannedBytes(config, mission, rig).images, std::uint64_t{36000} * 2 * (2 * 1360 * 1024 + 4096));
  config.planned_hours = 1e6;
  EXPECT_THAT(plannedRoomWarning(config, mission, rig, "."), ::testing::HasSubstr("images would stop after"));
  config.planned_hours = 0;
  config.image_reserve_mib = 0;
  EXPECT_EQ(plannedRoomWarning(config, mission, rig, "not/there/yet"), "");
}

}  // namespace
}  // namespace fathom::io
