#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "realtime/onboard/replay.hpp"
#include "telemetry/downlink/downlink.hpp"
#include "telemetry/wire/frame.hpp"
#include "tests/onboard/replayed_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::onboard {
namespace {

// A simulated dive of 30 pairs with truth/, rendered by the build before this test runs.
const std::filesystem::path kMission = FATHOM_REEF_MISSION;
using Bytes = std::vector<std::uint8_t>;

// A modem that receives given frames at given mission times.
class ScriptedModem final : public FramePort {
 public:
  void at(std::int64_t utc_ns, Bytes frame) { script_.emplace_back(utc_ns, std::move(frame)); }
  void setTime(std::int64_t now_ns) { now_ns_ = now_ns; }
  bool send(std::span<const std::uint8_t>) noexcept override { return true; }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    if (script_.empty() || script_.front().first > now_ns_) return 0;
    const Bytes frame = std::move(script_.front().second);
    script_.pop_front();
    std::memcpy(buffer.data(), frame.data(), frame.size());
    return frame.size();
  }
  std::uint64_t droppedFrames() const noexcept override { return 0; }

 private:
  std::int64_t now_ns_ = 0;
  std::deque<std::pair<std::int64_t, Bytes>> script_;
};

class DownlinkReplay : public ::testing::Test {
 protected:
  DownlinkReplay() {
    const io::MissionConfig mission = io::readMissionConfig(kMission);
    identity_ = {mission.vehicle_id, mission.dive_id};
    start_ns_ = mission.start_utc_ns;
    local_.emplace(mission.origin);
    truth_ = io::readTrajectory(kMission / "truth" / "trajectory.csv");
  }

  // Where the vehicle truly was, moved to the north by `off` [m].
  telemetry::UsblFixMessage fixAt(std::int64_t utc_ns, double off) const {
    const Eigen::Vector3d p = testing::poseAt(truth_, utc_ns).translation();
    const Geodetic g = local_->toGeodetic({p.x() + off, p.y()});
    return {utc_ns, g.latitude * kDegreesPerRadian, g.longitude * kDegreesPerRadian, p.z(), 0.3};
  }

  // Fixes a second old each second, all off alike, with noise and a stranger's frames between them.
  void script(ScriptedModem& modem, const std::optional<telemetry::LinkKey>& key, double off) const {
    telemetry::DownlinkSender ship(identity_, key);
    telemetry::DownlinkSender stranger({static_cast<std::uint8_t>(identity_.vehicle_id + 1), 1}, key);
    const std::int64_t last_ns = truth_.back().utc_ns;
    for (std::int64_t t = truth_.front().utc_ns + 2 * kSecond_ns; t < last_ns; t += kSecond_ns) {
      EXPECT_TRUE(ship.addFix(fixAt(t - kSecond_ns, off)));
      EXPECT_TRUE(stranger.addFix(fixAt(t - kSecond_ns, 500)));
      modem.at(t, padded(frameOf(ship, t)));
      modem.at(t, frameOf(stranger, t));
      modem.at(t, Bytes(40, 0x5A));
    }
  }
  static Bytes frameOf(telemetry::DownlinkSender& sender, std::int64_t now_ns) {
    Bytes frame(telemetry::kMaxFrameBytes);
    frame.resize(sender.nextFrame(now_ns, frame));
    return frame;
  }

  // As the ship answers a vehicle whose modem sends frames of one size.
  static Bytes padded(const Bytes& frame) {
    Bytes modem_frame(400);
    telemetry::ModemFrameWriter writer(modem_frame, true);
    std::copy(frame.begin(), frame.end(), writer.room().begin());
    writer.add(frame.size());
    modem_frame.resize(writer.finish());
    return modem_frame;
  }

  ReplayOptions into(const std::string& name) const {
    return ReplayOptions{.mission = kMission, .config = {}, .out = folder_.path() / name, .link = {}};
  }
  ReplaySummary runWith(ScriptedModem& modem, ReplayOptions options) const {
    options.link.modem = &modem;
    options.link.modem_clock = [&](std::int64_t now_ns) { modem.setTime(now_ns); };
    return replay(options);
  }
  double health(const std::string& run, const std::string& name) const {
    return nlohmann::json::parse(test::readText(folder_.path() / run / "report.json")).at("health").at(name);
  }
  Eigen::Vector3d meanPosition(const std::string& run) const {
    const auto poses = io::readStereoPoses(folder_.path() / run / "stereo_pose_est.data").poses;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const io::StereoPose& p : poses) sum += p.T_nav_cam.translation();
    return sum / static_cast<double>(poses.size());
  }

  test::TemporaryFolder folder_;
  telemetry::LinkIdentity identity_;
  std::int64_t start_ns_ = 0;
  std::optional<LocalTransverseMercator> local_;
  std::vector<io::TrajectoryPoint> truth_;
};

TEST_F(DownlinkReplay, FixesFromTheShipMoveTheTrackAndTheirRecordingReplaysToTheSameBytes) {
  replay(into("alone"));
  ScriptedModem modem;
  script(modem, std::nullopt, 4);
  const ReplaySummary live = runWith(modem, into("live"));
  EXPECT_GT(live.frames_received, 10u);
  EXPECT_GT(health("live", "downlink_fixes"), 5);
  EXPECT_EQ(health("live", "downlink_foreign"), health("live", "downlink_fixes"));
  EXPECT_EQ(health("live", "downlink_bad_frame"), health("live", "downlink_fixes"));
  const Eigen::Vector3d moved = meanPosition("live") - meanPosition("alone");
  // What all of a USBL's positions share is far less sure than GPS at the surface.
  EXPECT_GT(moved.x(), 0.1) << "many fixes 4 m north against what the mission has";
  EXPECT_LT(std::abs(moved.y()), 1);

  ReplayOptions again = into("again");
  again.link.downlink = folder_.path() / "live" / "downlink.bin";
  const ReplaySummary replayed = replay(again);
  EXPECT_EQ(replayed.frames_received, live.frames_received);
  EXPECT_EQ(testing::expectSameFiles(folder_.path() / "live", folder_.path() / "again"), 8);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "alone" / "downlink.bin"));
}

TEST_F(DownlinkReplay, AVehicleWithAKeyAcceptsNoFrameWithoutIt) {
  telemetry::makeLinkKey(folder_.path() / "ship.key");
  std::ofstream(folder_.path() / "onboard.toml") << "[link]\nkey_file = \"ship.key\"\n";
  replay(into("alone"));
  ScriptedModem modem;
  script(modem, std::nullopt, 4);
  ReplayOptions options = into("live");
  options.config = folder_.path() / "onboard.toml";
  runWith(modem, options);
  EXPECT_EQ(health("live", "downlink_fixes"), 0);
  EXPECT_GT(health("live", "downlink_unsigned"), 5);
  EXPECT_EQ(meanPosition("live"), meanPosition("alone"));

  std::string warning;
  ScriptedModem with_key;
  script(with_key, telemetry::readLinkKey(folder_.path() / "ship.key", warning), 4);
  options.out = folder_.path() / "signed";
  runWith(with_key, options);
  EXPECT_GT(health("signed", "downlink_fixes"), 5);
}

TEST_F(DownlinkReplay, AKeyFileThatCannotBeUsedStopsTheProgramBeforeTheDive) {
  std::ofstream(folder_.path() / "onboard.toml") << "[link]\nkey_file = \"nowhere.key\"\n";
  ReplayOptions options = into("out");
  options.config = folder_.path() / "onboard.toml";
  EXPECT_THROW(replay(options), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "out"));
}

TEST_F(DownlinkReplay, ADamagedRecordingIsRefusedAndNothingIsWritten) {
  const std::filesystem::path file = folder_.path() / "downlink.bin";
  const auto refused = [&] {
    ReplayOptions options = into("out");
    options.link.downlink = file;
    EXPECT_THROW(replay(options), InputError);
    EXPECT_FALSE(std::filesystem::exists(folder_.path() / "out"));
  };
  refused();
  std::ofstream(file) << "nonsense that is no packet";
  refused();
  std::ofstream stream(file, std::ios::binary);
  ASSERT_TRUE(telemetry::writePacket(stream, start_ns_ + kSecond_ns, Bytes{1}));
  ASSERT_TRUE(telemetry::writePacket(stream, start_ns_, Bytes{2}));
  stream.close();
  refused();
}

}  // namespace
}  // namespace fathom::onboard
