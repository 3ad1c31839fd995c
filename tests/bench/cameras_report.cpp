// Cost of two cameras: plays a mission's images from two simulated GigE Vision cameras, each in a network of
// its own, and receives them as the vehicle does.
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/reports.hpp"
#include "tests/support/network_namespace.hpp"

namespace fathom::bench {
namespace {

struct Exposure {
  std::int64_t utc_ns = 0;
  std::string file;
};

class Side final : public io::FrameSink {
 public:
  Side(const io::CameraConfig& config, io::VehicleTime now) : camera_(config, std::move(now)) {}
  void frame(const io::CameraFrame& frame) noexcept override {
    frames.push_back(frame);
    camera_.pool().release(frame.block);
  }
  void poll(std::int64_t until_ns) {
    while (rt::RealClock().utcNs() < until_ns) (void)camera_.poll(50, *this);
    poll_cpu_ms = cpuMs();
  }
  [[nodiscard]] io::GigeCamera& camera() { return camera_; }
  std::vector<io::CameraFrame> frames;
  double poll_cpu_ms = 0;

 private:
  io::GigeCamera camera_;
};

void printErrors(const std::vector<io::CameraFrame>& frames, const std::vector<Exposure>& exposures,
                 std::int64_t start_ns, double rate) {
  std::vector<double> stamp_ms, arrival_ms;
  for (const io::CameraFrame& frame : frames) {
    const auto due = [&](const Exposure& e) {
      return start_ns + static_cast<std::int64_t>(static_cast<double>(e.utc_ns - exposures[0].utc_ns) / rate);
    };
    const auto next = std::lower_bound(exposures.begin(), exposures.end(), frame.utc_ns,
                                       [&](const Exposure& e, std::int64_t utc) { return due(e) < utc; });
    std::int64_t off = INT64_MAX;
    for (const auto& e : {next == exposures.end() ? std::prev(next) : next,
                          next == exposures.begin() ? next : std::prev(next)})
      if (std::abs(frame.utc_ns - due(*e)) < std::abs(off)) off = frame.utc_ns - due(*e);
    stamp_ms.push_back(std::abs(static_cast<double>(off)) * 1e-6);
    arrival_ms.push_back(static_cast<double>(frame.arrival_utc_ns - (frame.utc_ns - off)) * 1e-6);
  }
  if (stamp_ms.empty()) return;
  std::printf("  mapped stamp off the true exposure: p50 %.3f ms, p99 %.3f ms, max %.3f ms\n",
              quantile(stamp_ms, 0.5), quantile(stamp_ms, 0.99), quantile(stamp_ms, 1));
  std::printf("  exposure to frame in hand: p50 %.1f ms, p99 %.1f ms, max %.1f ms\n",
              quantile(arrival_ms, 0.5), quantile(arrival_ms, 0.99), quantile(arrival_ms, 1));
}

struct CamerasOptions {
  std::filesystem::path mission;
  double rate_hz = 2, seconds = 20;
};

int runCameras(const CamerasOptions& options) {
  const auto& [folder, rate_hz, seconds] = options;
  const io::MissionConfig mission = io::readMissionConfig(folder);
  std::array<std::vector<Exposure>, 2> exposures;
  io::SensorLogReader log(folder);
  while (const auto entry = log.next())
    if (const auto* event = std::get_if<ImageEvent>(&entry->sample))
      exposures[static_cast<std::size_t>(event->side)].push_back({event->utc_ns, event->file_name});
  if (exposures[0].empty() || exposures[1].empty()) throw InputError(folder, "", "has no image pairs");
  if (const std::string why = test::ownNetwork(); !why.empty()) throw InputError("network", "", why);

  const double rate = rate_hz / mission.cameras.rate_hz;
  const rt::RealClock clock;
  const std::int64_t ahead = clock.utcNs() - clock.monotonicNs();
  const auto now = [ahead] { return rt::RealClock().monotonicNs() + ahead; };
  const std::int64_t start = clock.utcNs() + 5'000'000'000;
  std::vector<std::unique_ptr<test::NamespacedProcess>> cameras;
  std::vector<std::unique_ptr<Side>> sides;
  for (int n = 0; n < 2; ++n) {
    const auto i = static_cast<std::size_t>(n);
    const std::string serial = n == 0 ? "FTH-L" : "FTH-R";
    cameras.push_back(std::make_unique<test::NamespacedProcess>(
        n,
        std::vector<std::string>{FATHOM_BIN_DIR "/fathom-sim", "camera", "--mission", folder, "--side",
                                 n == 0 ? "left" : "right", "--serial", serial, "--interface",
                                 test::NamespacedProcess::deviceAddress(n), "--start", std::to_string(start),
                                 "--mission-start", std::to_string(exposures[i][0].utc_ns), "--rate",
                                 std::to_string(rate), "--clock-ppm", n == 0 ? "60" : "-40"}));
    const io::ImageFile first = io::readImage(
        folder / "img" / exposures[i][0].file,
        n == 0 ? mission.cameras.left_format : mission.cameras.right_format, mission.cameras.bits);
    io::CameraConfig config;
    config.side = static_cast<CameraSide>(n);
    config.id = serial;
    config.format = *io::wireFormat(n == 0 ? "BayerRG12Packed" : "Mono12Packed");
    config.width = first.view.width;
    config.height = first.view.height;
    config.rate_hz = rate_hz;
    sides.push_back(std::make_unique<Side>(config, now));
  }
  const auto end = start + static_cast<std::int64_t>(seconds * 1e9);
  const double before = 1e-3 * cpuMs(CLOCK_PROCESS_CPUTIME_ID);
  std::thread left([&] { sides[0]->poll(end); });
  sides[1]->poll(end);
  left.join();
  const double cpu = 1e-3 * cpuMs(CLOCK_PROCESS_CPUTIME_ID) - before;

  std::size_t frames = 0;
  for (int n = 0; n < 2; ++n) {
    const auto i = static_cast<std::size_t>(n);
    Side& side = *sides[i];
    frames += side.frames.size();
    std::size_t due = 0;
    for (const Exposure& e : exposures[i])
      due += static_cast<double>(e.utc_ns - exposures[i][0].utc_ns) * 1e-9 / rate < seconds - 0.1;
    std::printf("%s: %zu frames of %zu, packets of %d bytes, clock drift seen %.1f ppm\n",
                n == 0 ? "left" : "right", side.frames.size(), due, side.camera().packetSize(),
                side.camera().clockDrift() * 1e6);
    printErrors(side.frames, exposures[i], start, rate);
    for (const auto& [name, value] : side.camera().health().counters)
      if (value != 0)
        std::printf("  %s %llu\n", std::string(name).c_str(), static_cast<unsigned long long>(value));
    std::printf("  polling thread: %.2f ms CPU a frame (opening included)\n",
                side.poll_cpu_ms / static_cast<double>(std::max<std::size_t>(side.frames.size(), 1)));
  }
  std::printf(
      "whole process, searching and opening included: %.2f s CPU, %.2f ms a frame, %.1f %% of a core\n", cpu,
      1e3 * cpu / static_cast<double>(std::max<std::size_t>(frames, 1)), 100 * cpu / (seconds + 5));
  return 0;
}

}  // namespace

void camerasReport(CommandLine& program) {
  static CamerasOptions o;
  CommandLine& command = program.command(
      "cameras",
      "Two simulated cameras received as on the vehicle: CPU a frame, frames lost, stamps (as root)", "",
      [] { return runCameras(o); });
  command.add_option("mission", o.mission, "mission folder with images")->required();
  command.shown("--rate", o.rate_hz, "pairs a second", 0.1, 100);
  command.shown("--seconds", o.seconds, "of the measurement", 1, 1e5);
}

}  // namespace fathom::bench
