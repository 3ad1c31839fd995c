// The table before the launch: a vehicle with everything well, and with one thing wrong at a time.
#include <gmock/gmock.h>

#include <atomic>
#include <deque>
#include <nlohmann/json.hpp>
#include <thread>

#include "firmware_if/predive/predive_checks.hpp"
#include "firmware_if/predive/predive_watch.hpp"
#include "realtime/base/units.hpp"
#include "tests/firmware_if/synthetic_picture.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::io {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::int64_t kStart = 1'700'000'000 * kSecond_ns;

// Everything about a vehicle that a test can spoil.
struct Vehicle {
  MissionConfig mission;
  StereoRig rig;
  StereoCameraConfig cameras;
  PrediveConfig limits;
  RecorderConfig recorder;
  rt::SystemClockState clock{true, true, true, 0.001};
  rt::ArmingResult arming;
  std::uint64_t free_bytes = std::uint64_t{2000} << 30;
  std::array<std::string, 2> serials = {"FTH-L", "FTH-R"};
  std::array<bool, 2> camera_there = {true, true};
  std::array<double, 2> blur = {0, 0}, light = {1, 1};
  std::array<double, 2> rate_hz = {2, 2};
  double right_later_s = 0.001;
  int dark_every = 0;  // of the left frames
  int miss_every = 0;
  double dvl_hz = 7, compass_hz = 10, depth_hz = 4;
  std::uint64_t dvl_damaged = 0;
  bool dvl_lock = true;
  double depth = 0.2, roll = 0.02;
  bool usbl = true, modem_used = true, ship_speaks = true, for_us = true;
  double fix_latitude = -0.6;

  Vehicle() {
    mission.cameras.left_serial = "FTH-L";
    mission.cameras.right_serial = "FTH-R";
    mission.origin = {-0.6, 2.0};
    mission.T_body_cam = SE3::fromEuler(0.02, 0, kPi / 2, {0.5, 0, 0.3});
    mission.T_body_dvl = SE3::fromEuler(0, 0, 0, {-0.6, 0, 0.3});
    rig.left.width = rig.right.width = test::kWidth;
    rig.left.height = rig.right.height = test::kHeight;
    rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-0.07, 0, 0));
    for (const std::size_t side : {0U, 1U}) {
      cameras.side[side].id = side == 0 ? "FTH-L" : "FTH-R";
      cameras.side[side].rate_hz = 2;
    }
    arming.checks = {{"SCHED_FIFO", true, true, "granted", "", ""}};
  }
};

// Ends the look when every device was asked often enough, however slow the machine is.
class EnoughPolls {
 public:
  static constexpr int kPolls = 40;
  std::atomic<int>& another() { return polls_.emplace_back(0); }
  [[nodiscard]] bool reached() const {
    return std::all_of(polls_.begin(), polls_.end(), [](const auto& polls) { return polls >= kPolls; });
  }

 private:
  std::deque<std::atomic<int>> polls_;
};

// A device that gives its next sample at each poll, with the arrival time that its rate makes of it.
class FakeSource final : public SampleSource {
 public:
  FakeSource(const char* name, double rate_hz, std::atomic<int>& polls,
             std::function<SensorSample(std::int64_t)> make, std::uint64_t damaged = 0)
      : name_(name), rate_hz_(rate_hz), polls_(polls), make_(std::move(make)), damaged_(damaged) {}
  bool poll(int, SampleSink& sink) noexcept override {
    ++polls_;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (rate_hz_ <= 0) return true;
    const std::int64_t now = kStart + std::llround(static_cast<double>(given_++) / rate_hz_ * 1e9);
    sink.sample(now, make_(now));
    return true;
  }
  DeviceHealth health() const override {
    return DeviceHealth{
        .name = name_,
        .open = true,
        .reason = {},
        .last_data_ns = kStart,
        .samples = given_,
        .counters = {{"ensembles", given_}, {"bad_checksum", damaged_}, {"bytes", 800 * given_}}};
  }

 private:
  const char* name_;
  double rate_hz_;
  std::atomic<int>& polls_;
  std::function<SensorSample(std::int64_t)> make_;
  std::uint64_t damaged_, given_ = 0;
};

class FakeCamera final : public CameraSource {
 public:
  FakeCamera(const Vehicle& vehicle, std::size_t side, std::atomic<int>& polls)
      : vehicle_(vehicle),
        side_(side),
        polls_(polls),
        lit_(test::syntheticPicture(vehicle.blur[side], vehicle.light[side])),
        dark_(lit_.size(), 2),
        pool_(4, lit_.size()) {}
  bool poll(int, FrameSink& sink) noexcept override {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++polls_;
    if (!vehicle_.camera_there[side_]) return false;
    if (id_ == EnoughPolls::kPolls) return true;  // as many exposures of both cameras
    ++id_;
    if (side_ == 0 && vehicle_.miss_every > 0 && id_ % static_cast<std::uint64_t>(vehicle_.miss_every) == 0)
      return true;
    CameraFrame frame{.block = pool_.acquire()};
    EXPECT_NE(frame.block, rt::SharedBlocks::kNone) << "frames are given back at once";
    frame.frame_id = id_;
    frame.device_ns = std::llround(static_cast<double>(id_) / vehicle_.rate_hz[side_] * 1e9);
    frame.utc_ns = kStart + frame.device_ns + (side_ == 1 ? std::llround(vehicle_.right_later_s * 1e9) : 0);
    in_the_dark_ =
        side_ == 0 && vehicle_.dark_every > 0 && id_ % static_cast<std::uint64_t>(vehicle_.dark_every) == 0;
    sink.frame(frame);
    return true;
  }
  rt::SharedBlocks& pool() noexcept override { return pool_; }
  ImageView view(const CameraFrame&) noexcept override { return test::viewOf(in_the_dark_ ? dark_ : lit_); }
  DeviceHealth health() const override {
    return DeviceHealth{.name = "camera",
                        .open = true,
                        .reason = {},
                        .last_data_ns = kStart,
                        .samples = id_,
                        .counters = {{"clock_resets", 0}}};
  }

 private:
  const Vehicle& vehicle_;
  std::size_t side_;
  std::atomic<int>& polls_;
  std::vector<std::uint8_t> lit_, dark_;
  rt::SharedBlocks pool_;
  std::uint64_t id_ = 0;
  bool in_the_dark_ = false;
};

// A ship that answers each greeting with one frame.
class FakeModem final : public FramePort {
 public:
  FakeModem(bool speaks, std::atomic<int>& polls) : speaks_(speaks), polls_(polls) {}
  bool send(std::span<const std::uint8_t> frame) noexcept override {
    waiting_ += speaks_ && frame.size() == 3 ? 1 : 0;
    return true;
  }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    polls_ = EnoughPolls::kPolls;  // the greeting went out before
    if (waiting_ == 0) return 0;
    --waiting_;
    buffer[0] = 42;
    return 1;
  }
  std::uint64_t droppedFrames() const noexcept override { return 0; }

 private:
  bool speaks_;
  std::atomic<int>& polls_;
  int waiting_ = 0;
};

PrediveReport look(const Vehicle& vehicle) {
  PrediveDevices devices;
  EnoughPolls enough;
  for (const std::size_t side : {0U, 1U})
    devices.cameras[side] = {std::make_unique<FakeCamera>(vehicle, side, enough.another()), [&vehicle, side] {
                               return vehicle.camera_there[side]
                                          ? PrediveIdentity{vehicle.serials[side], "10.0.0.1", "", true}
                                          : PrediveIdentity{"", "", "no answer", false};
                             }};
  devices.expected[SensorSample(DvlSample{}).index()] = true;
  devices.expected[SensorSample(AttitudeSample{}).index()] = true;
  devices.expected[SensorSample(DepthSample{}).index()] = true;
  devices.sources.push_back(std::make_unique<FakeSource>(
      "dvl", vehicle.dvl_hz, enough.another(),
      [&](std::int64_t now) {
        DvlSample sample;
        sample.utc_ns = now;
        if (vehicle.dvl_lock) sample.velocity = Eigen::Vector3d(0, 0, 0);
        return sample;
      },
      vehicle.dvl_damaged));
  devices.sources.push_back(
      std::make_unique<FakeSource>("can", vehicle.compass_hz, enough.another(), [&](std::int64_t now) {
        return AttitudeSample{now, vehicle.roll, 0, 1.0, true};
      }));
  devices.sources.push_back(
      std::make_unique<FakeSource>("lcm", vehicle.depth_hz, enough.another(), [&](std::int64_t now) {
        return DepthSample{now, vehicle.depth};
      }));
  devices.modem_used = vehicle.modem_used;
  if (vehicle.modem_used) devices.modem = std::make_unique<FakeModem>(vehicle.ship_speaks, enough.another());
  devices.link.greet = [](std::int64_t, std::span<std::uint8_t> out) {
    out[0] = 1;
    return std::size_t{3};
  };
  devices.link.read = [&](std::span<const std::uint8_t> frame) {
    EXPECT_EQ(frame[0], 42);
    PrediveLink::Received received{.ours = vehicle.for_us, .fix = {}};
    if (vehicle.for_us && vehicle.usbl)
      received.fix = UsblFix{kStart, kStart, vehicle.fix_latitude, 2.0, 0, 1};
    return received;
  };
  const PrediveFacts facts = watchDevices(
      devices, [&] { return !enough.reached(); }, [] { return kStart; });
  PrediveReport report;
  checkExtrinsics(vehicle.mission, vehicle.rig, vehicle.limits, report);
  checkCameras(facts, vehicle.cameras, vehicle.mission, vehicle.rig, vehicle.limits, report);
  checkSensors(facts, vehicle.mission, vehicle.limits, report);
  checkClocks(facts, vehicle.clock, vehicle.limits, report);
  checkDisk(vehicle.recorder, vehicle.mission, vehicle.rig, vehicle.free_bytes, report);
  checkArming(vehicle.arming, report);
  return report;
}

std::vector<std::string> redRows(const PrediveReport& report) {
  std::vector<std::string> names;
  for (const PrediveRow& row : report.rows) {
    if (row.verdict != PrediveVerdict::kBad) continue;
    names.push_back(row.name);
    EXPECT_FALSE(row.fix.empty()) << row.name << " says no fix";
  }
  return names;
}

TEST(Predive, AVehicleInOrderIsGreenThroughout) {
  const PrediveReport report = look(Vehicle{});
  EXPECT_THAT(redRows(report), ::testing::IsEmpty()) << reportTable(report, false);
  EXPECT_TRUE(report.allGood());
  std::vector<std::string> unused;
  for (const PrediveRow& row : report.rows)
    if (row.verdict == PrediveVerdict::kUnused) unused.push_back(row.name);
  EXPECT_THAT(unused, ::testing::ElementsAre("GPS", "battery"));
}

struct Fault {
  const char* what;
  std::function<void(Vehicle&)> spoil;
  std::vector<std::string> red;
};

TEST(Predive, EachThingThatIsWrongTurnsItsOwnRowRed) {
  const std::vector<Fault> faults = {
      {"left lens out of focus", [](Vehicle& v) { v.blur[0] = 3.5; }, {"focus left"}},
      {"cameras exchanged", [](Vehicle& v) { std::swap(v.serials[0], v.serials[1]); }, {"serial numbers"}},
      {"right camera unplugged", [](Vehicle& v) { v.camera_there[1] = false; }, {"camera right"}},
      {"calibrated at another size", [](Vehicle& v) { v.rig.left.width = 1360; }, {"camera left"}},
      {"frames lost on the network", [](Vehicle& v) { v.miss_every = 10; }, {"camera left"}},
      {"trigger at half the rate",
       [](Vehicle& v) {
         v.rate_hz = {1, 1};
       },
       {"camera left", "camera right"}},
      {"right lens capped",
       [](Vehicle& v) { v.light[1] = 0.01; },
       {"exposure right", "focus right", "strobe"}},
      {"left over-exposed", [](Vehicle& v) { v.light[0] = 3; }, {"exposure left"}},
      {"strobe misses every fourth frame", [](Vehicle& v) { v.dark_every = 4; }, {"strobe"}},
      {"right exposes late", [](Vehicle& v) { v.right_later_s = 0.04; }, {"pair timing"}},
      {"cameras run freely",
       [](Vehicle& v) {
         v.rate_hz = {2, 2.05};
       },
       {"pair timing"}},
      {"DVL silent", [](Vehicle& v) { v.dvl_hz = 0; }, {"DVL"}},
      {"DVL slow", [](Vehicle& v) { v.dvl_hz = 1; }, {"DVL"}},
      {"DVL line noisy", [](Vehicle& v) { v.dvl_damaged = 1000; }, {"DVL"}},
      {"DVL in air is no fault", [](Vehicle& v) { v.dvl_lock = false; }, {}},
      {"compass silent", [](Vehicle& v) { v.compass_hz = 0; }, {"compass"}},
      {"compass in degrees", [](Vehicle& v) { v.roll = 3; }, {"compass"}},
      {"depth not zeroed", [](Vehicle& v) { v.depth = 10.3; }, {"depth"}},
      {"ship silent", [](Vehicle& v) { v.ship_speaks = false; }, {"USBL", "modem"}},
      {"ship speaks to another dive", [](Vehicle& v) { v.for_us = false; }, {"USBL", "modem"}},
      {"fix on another sea", [](Vehicle& v) { v.fix_latitude = 0.6; }, {"USBL"}},
      {"no modem is no fault", [](Vehicle& v) { v.modem_used = false; }, {}},
      {"system clock free", [](Vehicle& v) { v.clock.synchronised = false; }, {"system clock"}},
      {"a free system clock that nobody asked to be set",
       [](Vehicle& v) {
         v.clock.synchronised = false;
         v.limits.system_clock = false;
       },
       {}},
      {"disk full", [](Vehicle& v) { v.free_bytes = std::uint64_t{5} << 30; }, {"disk"}},
      {"millimetres in mission.toml",
       [](Vehicle& v) {
         v.mission.T_body_dvl = SE3::fromEuler(0, 0, 0, {-600, 0, 300});
       },
       {"sensor places"}},
      {"camera looks up",
       [](Vehicle& v) {
         v.mission.T_body_cam = SE3::fromEuler(kPi, 0, 0, {0.5, 0, 0.3});
       },
       {"looking down"}},
      {"cameras of the rig exchanged",
       [](Vehicle& v) { v.rig.T_right_left = v.rig.T_right_left.inverse(); },
       {"stereo rig"}},
      {"rig in millimetres",
       [](Vehicle& v) {
         v.rig.T_right_left = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-70, 0, 0));
       },
       {"stereo rig"}},
      {"no real-time privileges",
       [](Vehicle& v) { v.arming.checks[0] = {"SCHED_FIFO", false, true, "", "refused", "LimitRTPRIO=90"}; },
       {"SCHED_FIFO"}},
  };
  for (const Fault& fault : faults) {
    Vehicle vehicle;
    fault.spoil(vehicle);
    const PrediveReport report = look(vehicle);
    EXPECT_EQ(redRows(report), fault.red) << fault.what << "\n" << reportTable(report, false);
  }
}

TEST(Predive, TheTableNamesTheFixAndColoursOnlyATerminal) {
  PrediveReport report;
  report.good("DVL", "7 Hz");
  report.bad("focus left", "9 px", "turn the lens");
  report.unused("GPS", "not used");
  report.advise("kernel", "not PREEMPT_RT", "install one");
  const std::string plain = reportTable(report, false), coloured = reportTable(report, true);
  EXPECT_EQ(plain,
            "green  DVL         7 Hz\n"
            "RED    focus left  9 px\n"
            "                   -> turn the lens\n"
            "-      GPS         not used\n"
            "note   kernel      not PREEMPT_RT\n"
            "                   -> install one\n"
            "1 thing is wrong: do not dive.\n");
  EXPECT_THAT(coloured, ::testing::HasSubstr("\033[1;31mRED  \033[0m  focus left"));
  const auto json = nlohmann::json::parse(reportJson(report));
  EXPECT_EQ(json["good"], false);
  ASSERT_EQ(json["rows"].size(), 4u);
  EXPECT_EQ(json["rows"][1]["fix"], "turn the lens");
  EXPECT_EQ(json["rows"][2]["verdict"], "unused");
  EXPECT_EQ(json["rows"][3]["verdict"], "advice");
}

TEST(PrediveConfig, KeysAreBounded) {
  const ConfigTable table = ConfigTable::parse("[predive]\ndvl_hz = 7\nedge_px = 4", "onboard.toml");
  const PrediveConfig config = readKeys(table.table("predive"), PrediveConfig{}, visitPredive);
  EXPECT_EQ(config.dvl_hz, 7);
  EXPECT_EQ(config.edge_px, 4);
  const ConfigTable bad = ConfigTable::parse("[predive]\nedge_px = 1", "onboard.toml");
  EXPECT_THAT(test::refusal([&] { (void)readKeys(bad.table("predive"), PrediveConfig{}, visitPredive); }),
              ::testing::HasSubstr("edge_px"));
  for (const char* line : {"deck_tilt_deg = 91", "origin_km = 0", "least_charge = 1.1"}) {
    const ConfigTable beyond = ConfigTable::parse("[predive]\n" + std::string(line), "onboard.toml");
    EXPECT_NE(test::refusal([&] { (void)readKeys(beyond.table("predive"), PrediveConfig{}, visitPredive); }),
              "")
        << line;
  }
}

}  // namespace
}  // namespace fathom::io
