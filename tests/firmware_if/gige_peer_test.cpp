// Real GVCP and GVSP between network namespaces, from a camera that is not ours: Aravis' own.
#include <gtest/gtest.h>

#include <vector>

#include "firmware_if/devices/camera/camera_discovery.hpp"
#include "firmware_if/devices/camera/gige_camera.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "tests/support/heap_counter.hpp"
#include "tests/support/network_namespace.hpp"

namespace fathom::io {
namespace {

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

  CameraConfig config;
  config.id = "PEER1";
  config.format = *wireFormat("Mono8");
  config.width = 640;
  config.height = 480;
  config.rate_hz = 20;
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
