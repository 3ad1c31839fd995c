#include <gtest/gtest.h>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/frame_feed.hpp"
#include "telemetry/monitor/session.hpp"
#include "telemetry/wire/frame.hpp"
#include "tests/monitor/sample_dive.hpp"
#include "tests/support/full_disk.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::monitor {
namespace {

namespace fs = std::filesystem;

class Session : public ::testing::Test {
 protected:
  const fathom::test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.path() / "session";
};

std::vector<telemetry::Packet> packetsOf(double seconds) {
  return SampleDive{.duration_s = seconds}.packets();
}

void take(SessionFiles& files, MonitorModel& model, const telemetry::Packet& packet, bool recorded = false) {
  files.log(model.accept(packet.bytes, packet.utc_ns), packet.bytes, packet.utc_ns, recorded);
}

// How many frames; what is said of damage goes to `said`.
std::size_t reload(SessionFiles& files, MonitorModel& model, std::string& said) {
  return files.reload([&](auto bytes, auto utc_ns) { return model.accept(bytes, utc_ns).verdict; },
                      [&] { model.noteDamage(); }, said);
}

TEST_F(Session, AComputerThatWasOffComesBackWithItsMapAndItsAcknowledgement) {
  const auto packets = packetsOf(200);
  MonitorModel first;
  {
    SessionFiles files(folder_);
    for (const auto& packet : packets) take(files, first, packet);
    const std::vector<std::uint8_t> noise(40, 0xAB);
    files.log(first.accept(noise, 5), noise, 5, false);  // noise is not kept
  }                                                      // no orderly end: every frame is on the disk already
  SessionFiles files(folder_);
  MonitorModel second;
  std::string damage;
  EXPECT_EQ(reload(files, second, damage), packets.size());
  EXPECT_EQ(damage, "");
  EXPECT_EQ(second.map().store().size(), first.map().store().size());
  EXPECT_EQ(second.track().size(), first.track().size());
  EXPECT_EQ(second.receiver().acknowledgement(), first.receiver().acknowledgement());
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
  // An old turn is over; after a long silence the ship speaks unasked.
  EXPECT_EQ(second.speak(packets.back().utc_ns + 30'000'000'000, frame), 0U);
  EXPECT_GT(second.speak(packets.back().utc_ns + 3'600'000'000'000, frame), 0U);
}

TEST_F(Session, TheLinkFramesOfBundlesAreKeptOneByOne) {
  const auto packets = packetsOf(200);
  MonitorModel alone, together;
  for (const auto& packet : packets) alone.accept(packet.bytes, packet.utc_ns);
  {
    SessionFiles files(folder_);
    std::array<std::uint8_t, telemetry::kMaxModemBytes> bundle;
    for (std::size_t next = 0; next < packets.size();) {
      telemetry::ModemFrameWriter modem(bundle, true);
      for (; next < packets.size() && modem.room().size() >= packets[next].bytes.size(); ++next) {
        std::copy(packets[next].bytes.begin(), packets[next].bytes.end(), modem.room().begin());
        modem.add(packets[next].bytes.size());
      }
      const std::size_t size = modem.finish();
      EXPECT_TRUE(together.receive(std::span(bundle).first(size), packets.back().utc_ns,
                                   [&](const auto& frame, std::span<const std::uint8_t> link_frame) {
                                     files.log(frame, link_frame, packets.back().utc_ns, false);
                                   }));
    }
  }
  EXPECT_EQ(together.map().store().size(), alone.map().store().size());
  EXPECT_EQ(together.track().size(), alone.track().size());
  EXPECT_EQ(together.receiver().acknowledgement(), alone.receiver().acknowledgement());
  telemetry::PacketLogReader reader(folder_ / "received.bin");
  for (const auto& packet : packets) {
    const auto kept = reader.next();
    ASSERT_TRUE(kept);
    EXPECT_EQ(kept->bytes, packet.bytes);
  }
}

TEST_F(Session, ADamagedEndIsCutOffAndTheNextFrameFollowsWhatIsWhole) {
  const auto packets = packetsOf(60);
  {
    SessionFiles files(folder_);
    MonitorModel model;
    for (const auto& packet : packets) take(files, model, packet);
  }
  const auto whole = fs::file_size(folder_ / "received.bin");
  for (const std::uintmax_t cut :
       {whole - 1, whole - packets.back().bytes.size(), whole - packets.back().bytes.size() - 3}) {
    fs::resize_file(folder_ / "received.bin", cut);
    SessionFiles files(folder_);
    MonitorModel model;
    std::string damage;
    EXPECT_EQ(reload(files, model, damage), packets.size() - 1);
    EXPECT_NE(damage.find("cut off"), std::string::npos);
    take(files, model, packets.back());
    EXPECT_EQ(fs::file_size(folder_ / "received.bin"), whole);
  }
}

TEST_F(Session, DamageInTheMiddleTakesOnlyWhatItHitsAndTheShipSaysWhatItLacks) {
  const auto packets = packetsOf(300);
  std::uintmax_t middle = 0;
  {
    SessionFiles files(folder_);
    MonitorModel model;
    for (std::size_t k = 0; k < packets.size(); ++k) {
      if (k == packets.size() / 2) middle = fs::file_size(folder_ / "received.bin");
      take(files, model, packets[k]);
    }
  }
  for (const std::string& damage : {std::string(3, '\x7f'), std::string(30, '\0'), std::string(1, '\x55')})
    for (const std::uintmax_t at : {middle, middle + 13}) {
      fs::create_directories(folder_ / "copy");
      fs::copy_file(folder_ / "received.bin", folder_ / "copy/received.bin",
                    fs::copy_options::overwrite_existing);
      std::fstream(folder_ / "copy/received.bin", std::ios::in | std::ios::out | std::ios::binary)
          .seekp(static_cast<std::streamoff>(at))
          .write(damage.data(), static_cast<std::streamsize>(damage.size()));
      SessionFiles files(folder_ / "copy");
      MonitorModel model;
      std::string said;
      const std::size_t count = reload(files, model, said);
      EXPECT_GE(count, packets.size() - 3);
      EXPECT_LT(count, packets.size());
      EXPECT_NE(said.find("received.bin"), std::string::npos);
    }
}

TEST_F(Session, AFullDiskEndsNothingAndNothingIsAcknowledgedThatItDidNotTake) {
  const auto packets = packetsOf(200);
  MonitorModel model;
  SessionFiles files(folder_);
  ExportFiles exports(folder_);
  std::array<std::uint8_t, telemetry::kMaxFrameBytes> frame;
  const auto takeFrom = [&](std::size_t from, std::size_t to) {
    for (std::size_t k = from; k < to; ++k) take(files, model, packets[k]);
  };
  const auto acknowledged = [&](int turn) -> std::optional<std::uint16_t> {
    const std::size_t size =
        model.speak(packets.back().utc_ns + turn * 3'600'000'000'000, frame, [&] { return files.keep(); });
    telemetry::DecodedDownlink said;
    const auto whole = telemetry::decodeFrame(std::span(frame).first(size));
    if (!telemetry::decodeDownlink(whole.payload, said)) return std::nullopt;
    return said.content.acknowledgement->newest;
  };
  const std::size_t third = packets.size() / 3;
  takeFrom(0, third);
  const auto before = acknowledged(1);
  ASSERT_TRUE(before);
  {
    const fathom::test::FullDisk full(fs::file_size(folder_ / "received.bin") + 50);
    takeFrom(third, 2 * third);
    ModelView view;
    view.take(model);
    exports.save(view);
    EXPECT_NE(exports.trouble(), "");
    EXPECT_FALSE(files.keep());
    EXPECT_NE(files.trouble().find("received.bin"), std::string::npos);
    EXPECT_EQ(acknowledged(2), before);
  }
  takeFrom(2 * third, packets.size());
  EXPECT_TRUE(files.keep());
  ModelView view;
  view.take(model);
  exports.save(view);
  EXPECT_EQ(files.trouble() + exports.trouble(), "");
  const auto first = acknowledged(3), second = acknowledged(4);  // one of them looks back
  EXPECT_GT(std::max(*first, *second), *before);
  MonitorModel again;
  std::string damage;
  EXPECT_EQ(reload(files, again, damage), packets.size());
  EXPECT_EQ(damage, "");
}

TEST_F(Session, SavesWholeExportsAndKeepsALineAFrame) {
  MonitorModel model;
  SessionFiles files(folder_);
  ExportFiles exports(folder_);
  ModelView view;
  exports.save(view);
  EXPECT_FALSE(fs::exists(folder_ / "map.ply") || fs::exists(folder_ / "track.geojson"));
  std::size_t frames = 0;
  for (const auto& packet : packetsOf(150)) {
    take(files, model, packet, true);
    ++frames;
  }
  view.take(model);
  exports.save(view);
  for (const char* name : {"map.ply", "elevation.tif", "colour.tif", "track.geojson"})
    EXPECT_GT(fs::file_size(folder_ / name), 200U) << name;
  for (const auto& entry : fs::directory_iterator(folder_)) EXPECT_NE(entry.path().extension(), ".tmp");
  EXPECT_EQ(fs::file_size(folder_ / "received.bin"), 0U);  // a recording is on the disk already
  std::ifstream log(folder_ / "frames.log");
  std::size_t lines = 0;
  for (std::string line; std::getline(log, line);) ++lines;
  EXPECT_EQ(lines, frames + 1);
}

TEST_F(Session, ARecordingPlaysPausesSeeksAndGoesBack) {
  fs::create_directories(folder_);
  const auto packets = packetsOf(100);
  {
    std::ofstream stream(folder_ / "packets.bin", std::ios::binary);
    for (const auto& packet : packets)
      ASSERT_TRUE(telemetry::writePacket(stream, packet.utc_ns, packet.bytes));
  }
  Recording recording(folder_ / "packets.bin");
  std::size_t given = 0;
  const auto count = [&](std::span<const std::uint8_t>, std::int64_t) { return ++given > 0; };
  const auto upTo = [&](double t) {
    return static_cast<std::size_t>(std::count_if(packets.begin(), packets.end(), [&](const auto& p) {
      return p.utc_ns <= packets.front().utc_ns + static_cast<std::int64_t>(t * 1e9);
    }));
  };
  recording.setSpeed(10, kSecond_ns);
  while (recording.poll(count, 3 * kSecond_ns) > 0) continue;
  EXPECT_EQ(given, upTo(20));
  recording.setPlaying(false, 3 * kSecond_ns);
  EXPECT_EQ(recording.poll(count, 90 * kSecond_ns), 0U);
  EXPECT_FALSE(recording.seek(packets.front().utc_ns + 50 * kSecond_ns, 90 * kSecond_ns));
  while (recording.poll(count, 90 * kSecond_ns) > 0) continue;
  EXPECT_EQ(given, upTo(50));
  given = 0;
  EXPECT_TRUE(recording.seek(packets.front().utc_ns + 10 * kSecond_ns, 91 * kSecond_ns));
  while (recording.poll(count, 91 * kSecond_ns) > 0) continue;
  EXPECT_EQ(given, upTo(10));
  recording.setSpeed(0, 92 * kSecond_ns);
  recording.setPlaying(true, 92 * kSecond_ns);
  while (!recording.finished()) recording.poll(count, 92 * kSecond_ns);
  EXPECT_EQ(given, packets.size());
  EXPECT_EQ(recording.atUtcNs(), packets.back().utc_ns);
}

TEST_F(Session, ARecordingDamagedInTheMiddleKeepsWhatComesBefore) {
  fs::create_directories(folder_);
  {
    std::ofstream stream(folder_ / "packets.bin", std::ios::binary);
    for (const auto& packet : packetsOf(60))
      ASSERT_TRUE(telemetry::writePacket(stream, packet.utc_ns, packet.bytes));
  }
  fs::resize_file(folder_ / "packets.bin", fs::file_size(folder_ / "packets.bin") - 1);
  EXPECT_NE(Recording(folder_ / "packets.bin").damage(), "");
  fs::resize_file(folder_ / "packets.bin", 7);
  EXPECT_THROW(Recording(folder_ / "packets.bin"), InputError);
}

// Gives one frame after the other and records those that were reported as accepted.
struct CountingPort final : FramePort {
  std::vector<std::vector<std::uint8_t>> frames;
  std::size_t given = 0;
  std::vector<std::size_t> accepted_frames;
  bool send(std::span<const std::uint8_t>) noexcept override { return true; }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    if (given == frames.size()) return 0;
    const auto& frame = frames[given++];
    std::copy(frame.begin(), frame.end(), buffer.begin());
    return frame.size();
  }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }
  void answerLastSender() noexcept override { accepted_frames.push_back(given - 1); }
};

TEST(LiveFeed, ReportsToThePortWhichFramesWereAccepted) {
  const auto packets = packetsOf(60);
  auto port = std::make_unique<CountingPort>();
  CountingPort& counting = *port;
  std::vector<std::uint8_t> damaged = packets[1].bytes;
  damaged.back() ^= 1;
  counting.frames = {packets[0].bytes, std::vector<std::uint8_t>(40, 0xAB), damaged, packets[0].bytes,
                     packets[1].bytes};
  std::vector<std::unique_ptr<FramePort>> ports;
  ports.push_back(std::move(port));
  LiveFeed feed(std::move(ports));
  MonitorModel model;
  EXPECT_EQ(feed.poll([&](std::span<const std::uint8_t> bytes, std::int64_t utc_ns) {
    return model.receive(bytes, utc_ns);
  }),
            5U);
  EXPECT_EQ(counting.accepted_frames, (std::vector<std::size_t>{0, 4}))
      << "one that comes again may be replayed";
}

}  // namespace
}  // namespace fathom::monitor
