#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "firmware_if/devices/camera/gige_camera.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/support/network_namespace.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {

inline constexpr int kBenchWidth = 97, kBenchHeight = 61;  // odd: the last packed pixel stands alone

// A mission of small 12-bit images, no two alike, and the schedule that plays them at a rate.
class BenchMission {
 public:
  BenchMission(int images, double rate_hz) : images_(images), period_s_(1 / rate_hz) {
    io::MissionConfig config;
    config.cameras.rate_hz = rate_hz;
    config.cameras.left_serial = "BENCH-L";
    config.cameras.right_serial = "BENCH-R";
    io::writeMissionConfig(folder_.path(), config);
    std::filesystem::create_directory(folder_.path() / "img");
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      std::ofstream list(schedule(side));
      for (int i = 0; i < images; ++i) {
        io::writeImage(folder_.path() / "img" / fileName(i, side), view(pixels(i, side)));
        list << i * period_s_ << ',' << fileName(i, side) << '\n';
      }
    }
  }
  [[nodiscard]] const std::filesystem::path& path() const { return folder_.path(); }
  [[nodiscard]] std::filesystem::path schedule(CameraSide side) const {
    return folder_.path() / (side == CameraSide::kLeft ? "left.csv" : "right.csv");
  }
  [[nodiscard]] int images() const { return images_; }
  [[nodiscard]] double periodS() const { return period_s_; }
  [[nodiscard]] static std::string fileName(int i, CameraSide side) {
    return io::imageFileName(1'700'000'000'000'000'000 + i * std::int64_t{1'000'000'000}, side);
  }
  [[nodiscard]] static std::vector<std::uint16_t> pixels(int i, CameraSide side) {
    std::vector<std::uint16_t> pixels(kBenchWidth * kBenchHeight);
    std::uint32_t state = static_cast<std::uint32_t>(2 * i + (side == CameraSide::kRight ? 1 : 0)) + 1;
    for (std::uint16_t& pixel : pixels) {
      state = state * 1664525U + 1013904223U;
      pixel = static_cast<std::uint16_t>(state >> 20);
    }
    return pixels;
  }
  [[nodiscard]] static ImageView view(const std::vector<std::uint16_t>& pixels) {
    return {.data = pixels.data(),
            .width = kBenchWidth,
            .height = kBenchHeight,
            .stride = 2 * kBenchWidth,
            .format = PixelFormat::kMono,
            .bits = 12};
  }

 private:
  TemporaryFolder folder_;
  int images_;
  double period_s_;
};

inline std::int64_t systemUtcNs() {
  return rt::RealClock().utcNs();
}

// `fathom-sim camera` on cable `n`.
class BenchCamera {
 public:
  BenchCamera(int n, const BenchMission& mission, CameraSide side, std::int64_t start_utc_ns,
              std::vector<std::string> more = {})
      : log_(mission.path() / ("camera" + std::to_string(n) + ".csv")),
        process_(n, command(n, mission, side, start_utc_ns, log_, std::move(more)),
                 (mission.path() / ("camera" + std::to_string(n) + ".txt")).string()) {}
  [[nodiscard]] NamespacedProcess& process() { return process_; }
  [[nodiscard]] static std::string serial(int n) { return "BENCH-" + std::to_string(n); }
  // Exposures with this fate in the camera's log.
  [[nodiscard]] int count(const std::string& fate) const {
    std::ifstream in(log_);
    std::string line;
    int count = 0;
    while (std::getline(in, line)) count += line.find("," + fate + ",") != std::string::npos;
    return count;
  }

 private:
  static std::vector<std::string> command(int n, const BenchMission& mission, CameraSide side,
                                          std::int64_t start, const std::filesystem::path& log,
                                          std::vector<std::string> more) {
    std::vector<std::string> argv{FATHOM_BIN_DIR "/fathom-sim",
                                  "camera",
                                  "--mission",
                                  mission.path(),
                                  "--side",
                                  side == CameraSide::kLeft ? "left" : "right",
                                  "--serial",
                                  serial(n),
                                  "--interface",
                                  NamespacedProcess::deviceAddress(n),
                                  "--start",
                                  std::to_string(start),
                                  "--schedule",
                                  mission.schedule(side),
                                  "--log",
                                  log};
    argv.insert(argv.end(), more.begin(), more.end());
    return argv;
  }
  std::filesystem::path log_;
  NamespacedProcess process_;
};

// A client that holds each frame against the image that was exposed at its time.
class BenchClient final : public io::FrameSink {
 public:
  BenchClient(int n, const BenchMission& mission, CameraSide side, const char* format,
              std::int64_t start_utc_ns, int packet_size = 0,
              io::CameraTrigger trigger = io::CameraTrigger::kFreeRun)
      : mission_(mission),
        side_(side),
        start_(start_utc_ns),
        camera_(config(n, mission, side, format, packet_size, trigger), time()) {}

  // Polls until then (system's UTC).
  void pollUntil(std::int64_t utc_ns) {
    while (systemUtcNs() < utc_ns) (void)camera_.poll(20, *this);
  }
  void pollFor(double seconds) { pollUntil(systemUtcNs() + static_cast<std::int64_t>(seconds * 1e9)); }

  void frame(const io::CameraFrame& frame) noexcept override {
    const double index = static_cast<double>(frame.utc_ns - start_) * 1e-9 / mission_.periodS();
    const int i = static_cast<int>(std::lround(index));
    worst_s = std::max(worst_s, std::abs(index - i) * mission_.periodS());
    const std::vector<std::uint16_t> expected = BenchMission::pixels(std::clamp(i, 0, 1 << 20), side_);
    const ImageView view = camera_.view(frame);
    bool same = view.width == kBenchWidth && view.height == kBenchHeight && view.bits == 12;
    for (int y = 0; same && y < kBenchHeight; ++y)
      same = std::memcmp(static_cast<const char*>(view.data) + static_cast<std::size_t>(y) * view.stride,
                         &expected[static_cast<std::size_t>(y * kBenchWidth)], 2 * kBenchWidth) == 0;
    wrong += !same;
    camera_.pool().release(frame.block);
    frames.push_back(frame);
    indices.push_back(i);
  }
  [[nodiscard]] std::uint64_t count(std::string_view name) const {
    for (const auto& [counter, value] : camera_.health().counters)
      if (counter == name) return value;
    ADD_FAILURE() << "no counter " << name;
    return 0;
  }
  [[nodiscard]] io::GigeCamera& camera() { return camera_; }

  std::vector<io::CameraFrame> frames;
  std::vector<int> indices;  // of the images
  int wrong = 0;             // frames with other pixels than those exposed at their time
  double worst_s = 0;        // largest error of a frame's time

 private:
  static io::CameraConfig config(int n, const BenchMission& mission, CameraSide side, const char* format,
                                 int packet_size, io::CameraTrigger trigger) {
    io::CameraConfig config;
    config.side = side;
    config.id = BenchCamera::serial(n);
    config.format = *io::wireFormat(format);
    config.width = kBenchWidth;
    config.height = kBenchHeight;
    config.rate_hz = 1 / mission.periodS();
    config.exposure_us = 2000;
    config.packet_size = packet_size;
    config.trigger = trigger;
    config.interface = NamespacedProcess::linkName(n);
    return config;
  }
  // The vehicle's time is the system's clock, as in the schedule.
  static io::VehicleTime time() {
    const std::int64_t ahead = systemUtcNs() - rt::RealClock().monotonicNs();
    return [ahead] { return rt::RealClock().monotonicNs() + ahead; };
  }
  const BenchMission& mission_;
  CameraSide side_;
  std::int64_t start_;
  io::GigeCamera camera_;
};

}  // namespace fathom::test
