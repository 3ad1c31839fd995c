// `fathom-sensors predive` as a person runs it: devices on real interfaces of a network of the test's own.
#include <gmock/gmock.h>

#include <atomic>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "firmware_if/devices/camera/camera_discovery.hpp"
#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/devices/lcm/lcm_source.hpp"
#include "firmware_if/devices/modem/modem_ports.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "telemetry/ship/ship_link.hpp"
#include "tests/firmware_if/pd0_builder.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/network_namespace.hpp"
#include "tests/support/program_run.hpp"
#include "tests/support/pty_line.hpp"

namespace fathom::io {
namespace {

using ::testing::HasSubstr;

constexpr double kPi = 3.14159265358979323846;
constexpr const char* kBus = "udpm://239.255.76.67:7667?ttl=0";

test::Outcome predive(const std::string& arguments) {
  return test::runProgram("fathom-sensors predive " + arguments);
}

void writeMission(const std::filesystem::path& folder) {
  MissionConfig mission;
  mission.cameras.left_serial = "PEER1";
  mission.cameras.right_serial = "PEER2";
  mission.cameras.left_format = mission.cameras.right_format = PixelFormat::kMono;
  mission.cameras.bits = 8;
  mission.cameras.rate_hz = 4;
  mission.origin = {-0.6, 2.0};
  mission.start_utc_ns = 1'700'000'000'000'000'000;
  mission.T_body_cam = SE3::fromEuler(0.02, 0, kPi / 2, {0.5, 0, 0.3});
  writeMissionConfig(folder, mission);
  const Camera camera{640, 480, 800, 800, 320, 240};
  writeStereoCalib(MissionPaths(folder).calib(), {camera, camera, SE3::fromEuler(0, 0, 0, {-0.07, 0, 0})});
}

std::string onboardToml(const std::string& dvl, const std::string& modem) {
  return "[cameras]\nleft = 'PEER1'\nright = 'PEER2'\nwidth = 640\nheight = 480\nexposure_us = "
         "10000\ngain_db = 0\n"
         "packet_size = 8000\n[dvl]\ndevice = 'serial:" +
         dvl + ":115200'\n[lcm]\nurl = '" + kBus +
         "'\naccept = 'attitude depth battery'\n[modem]\ndevice = 'serial:" + modem +
         ":9600'\n[recorder]\nplanned_hours = 0.01\n[predive]\nsystem_clock = false\n[link]\nrate_bps = "
         "1000\n";
}

// A vehicle's other devices and its ship, until it goes.
class Surroundings {
 public:
  Surroundings() : bus_(std::make_shared<LcmBus>(kBus)), thread_([this] { run(); }) {}
  ~Surroundings() {
    stop_ = true;
    thread_.join();
  }
  test::PtyLine dvl, modem;
  std::atomic<bool> compass{true}, ship{true};

 private:
  void run() {
    const rt::RealClock clock;
    telemetry::ShipLink link(std::nullopt, std::nullopt);
    SlipDecoder decoder;
    std::array<std::uint8_t, 512> bytes;
    for (int tick = 0; !stop_; ++tick) {
      const std::int64_t now = clock.utcNs();
      if (tick % 12 == 0) sendEnsemble(now);
      if (tick % 10 == 0) {
        if (compass) bus_->publish(encodeSample(now, AttitudeSample{now, 0.01, 0.02, 1.0, true}));
        bus_->publish(encodeSample(now, DepthSample{now, 0.3}));
        BatterySample battery{.utc_ns = now, .voltage = {}, .current = {}, .charge = 0.9};
        bus_->publish(encodeSample(now, battery));
      }
      const ssize_t n = modem.read(bytes);
      for (ssize_t i = 0; i < n; ++i)
        if (decoder.push(bytes[static_cast<std::size_t>(i)]))
          static_cast<void>(link.accept(now, decoder.frame(), [](const auto&) { return true; }));
      if (ship && link.sender() != nullptr) {
        static_cast<void>(link.sender()->addFix({now - 2'000'000'000, -34.377, 114.59, 0, 1.5}));
        std::array<std::uint8_t, 256> frame;
        std::array<std::uint8_t, kMaxSlipBytes> line;
        const std::size_t size = link.nextFrame(now, frame);
        if (size > 0) modem.send({line.data(), slipEncode({frame.data(), size}, line)});
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  }
  void sendEnsemble(std::int64_t now) {
    test::Pd0Builder builder;
    builder.setClock(now);
    dvl.offer(builder.bytes());
  }
  std::shared_ptr<LcmBus> bus_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

std::map<std::string, std::string> verdicts(const std::string& json) {
  std::map<std::string, std::string> out;
  const auto report = nlohmann::json::parse(json, nullptr, false);
  if (report.is_discarded()) {
    ADD_FAILURE() << json;
    return out;
  }
  for (const auto& row : report["rows"]) out[row["name"]] = row["verdict"];
  return out;
}

TEST(PrediveProgram, FindsDevicesOnTheirInterfacesAndSaysWhichAreWrong) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  if (!sim::ipCommand("route add 239.255.76.67/32 dev lo")) GTEST_SKIP() << "no multicast route can be made";
  const auto camera = [](int n, const char* serial) {
    return std::vector<std::string>{"arv-fake-gv-camera-0.8", "-i", test::NamespacedProcess::deviceAddress(n),
                                    "-s", serial};
  };
  test::NamespacedProcess left(0, camera(0, "PEER1")), right(1, camera(1, "PEER2"));
  Surroundings around;
  const test::TemporaryFolder folder;
  writeMission(folder.path());
  const std::string config = (folder.path() / "onboard.toml").string();
  test::writeText(config, onboardToml(around.dvl.name(), around.modem.name()));
  const std::string arguments = folder.path().string() + " --config " + config + " --json --seconds 7";

  const test::Outcome well = predive(arguments);
  if (test::sanitized()) {
    constexpr int kRace = 66;  // ThreadSanitizer's exit code
    EXPECT_NE(well.exit_code, kRace) << well.out;
    GTEST_SKIP() << "a sanitizer makes the program too slow for two cameras in real time";
  }
  auto rows = verdicts(well.out);
  for (const char* name : {"mission.toml", "stereo.calib", "onboard.toml", "sensor places", "looking down",
                           "stereo rig", "camera left", "camera right", "serial numbers", "DVL", "compass",
                           "depth", "USBL", "battery", "modem", "disk", "memory budget"})
    EXPECT_EQ(rows[name], "good") << name << "\n" << well.out;

  // Five things wrong: a cable pulled, the other camera calibrated in its place, the compass and the ship
  // silent, a rig in millimetres.
  left.unplug();
  around.compass = false;
  around.ship = false;
  MissionConfig mission = readMissionConfig(folder.path());
  mission.T_body_dvl = SE3::fromEuler(0, 0, 0, {60, 0, 0});
  writeMissionConfig(folder.path(), mission);
  test::writeText(config,
                  test::replaced(onboardToml(around.dvl.name(), around.modem.name()), "0.01", "1000"));
  const test::Outcome wrong = predive(arguments);
  EXPECT_EQ(wrong.exit_code, 1);
  rows = verdicts(wrong.out);
  for (const char* name : {"camera left", "compass", "modem", "USBL", "sensor places", "disk"})
    EXPECT_EQ(rows[name], "bad") << name << "\n" << wrong.out;
  for (const char* name : {"camera right", "DVL", "depth", "mission.toml"})
    EXPECT_EQ(rows[name], "good") << name << "\n" << wrong.out;
}

TEST(PrediveProgram, FilesThatCannotBeReadAreRedRowsThatNameTheFix) {
  const test::TemporaryFolder folder;
  const test::Outcome absent = predive("/absent --config /absent.toml --seconds 0.1");
  EXPECT_EQ(absent.exit_code, 1);
  EXPECT_THAT(absent.out, HasSubstr("RED    mission.toml"));
  EXPECT_THAT(absent.out, HasSubstr("RED    stereo.calib"));
  EXPECT_THAT(absent.out, HasSubstr("-> correct it"));
  writeMission(folder.path());
  const std::string config = (folder.path() / "onboard.toml").string();
  test::writeText(config, "[dvl]\nbaud = 9600\n");
  const test::Outcome misspelt = predive(folder.path().string() + " --config " + config + " --seconds 0.1");
  EXPECT_EQ(misspelt.exit_code, 1);
  EXPECT_THAT(misspelt.out, HasSubstr("baud"));
  EXPECT_THAT(misspelt.out, HasSubstr("green  mission.toml"));
  EXPECT_EQ(predive("--seconds 1").exit_code, 2);
  EXPECT_THAT(predive("--help").out, HasSubstr("Example: fathom-sensors predive"));
}

// Real GVCP and GVSP between network namespaces, from a camera that is not ours: Aravis' own.

std::int64_t vehicleTime() {
  return rt::RealClock().monotonicNs() + 1'700'000'000'000'000'000;
}

// Keeps what comes, and the pixels' check.
class Frames final : public FrameSink {
 public:
  explicit Frames(CameraSource& source) : source_(source) {}
  void frame(const CameraFrame& frame) noexcept override {
    frames.push_back(frame);
    const ImageView view = source_.view(frame);
    const auto* pixels = static_cast<const std::uint8_t*>(view.data);
    // Aravis' ramp: x + y + a number that goes with the frame, modulo 255.
    const int first = pixels[0];
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x)
        bad_pixels += pixels[static_cast<std::size_t>(y) * view.stride + static_cast<std::size_t>(x)] !=
                      (first + x + y) % 255;
    source_.pool().release(frame.block);
  }
  std::vector<CameraFrame> frames;
  int bad_pixels = 0;

 private:
  CameraSource& source_;
};

TEST(GigeCamera, StreamsWholeFramesFromAravisOwnCamera) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  test::NamespacedProcess peer(
      0, {"arv-fake-gv-camera-0.8", "-i", test::NamespacedProcess::deviceAddress(0), "-s", "PEER1"});

  CameraConfig config{.id = "PEER1",
                      .format = *wireFormat("Mono8"),
                      .width = 640,
                      .height = 480,
                      .rate_hz = 20,
                      .interface = {}};
  config.exposure_us = 10'000;  // the ramp's brightness then is one a step
  config.gain_db = 0;
  config.packet_size = 8000;
  config.interface = test::NamespacedProcess::linkName(0);
  GigeCamera camera(config, vehicleTime);
  Frames frames(camera);
  const std::int64_t end = vehicleTime() + (test::sanitized() ? 200'000'000'000 : 20'000'000'000);
  while (frames.frames.size() < 30 && vehicleTime() < end) camera.poll(100, frames);

  ASSERT_GE(frames.frames.size(), 30u) << camera.lastFailure();
  EXPECT_EQ(frames.bad_pixels, 0);
  if (test::sanitized())
    GTEST_SKIP() << "a sanitizer is too slow for every frame of 20 a second; those received were whole";
  EXPECT_EQ(camera.serial(), "PEER1");
  EXPECT_EQ(camera.packetSize(), 8000);
  for (std::size_t i = 1; i < frames.frames.size(); ++i) {
    EXPECT_EQ(frames.frames[i].frame_id, frames.frames[i - 1].frame_id + 1);
    EXPECT_GT(frames.frames[i].utc_ns, frames.frames[i - 1].utc_ns);
    EXPECT_LT(frames.frames[i].utc_ns, frames.frames[i].arrival_utc_ns + 5'000'000);
  }
  const auto span_ns = static_cast<double>(frames.frames.back().utc_ns - frames.frames.front().utc_ns);
  EXPECT_NEAR(span_ns * 1e-9 / static_cast<double>(frames.frames.size() - 1), 0.05, 0.02);
  EXPECT_EQ(camera.pool().held(), 0u);
  DeviceHealth health = camera.health();
  EXPECT_TRUE(health.open);
  for (const auto& [name, value] : health.counters) {
    if (name == "open_failed") continue;
    // Its clock cannot be read: it is estimated from five arrivals.
    EXPECT_EQ(value, name == "clock_unsettled" ? 4u : 0u) << name;
  }
}

}  // namespace
}  // namespace fathom::io
