// The camera driver against simulated cameras, over real GVCP and GVSP between network namespaces.
#include <thread>

#include "realtime/base/units.hpp"
#include "tests/sim/gige_bench.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom {
namespace {

using test::BenchCamera, test::BenchClient, test::BenchMission;

// Frames' times on a busy machine, a tenth of a period at most.
constexpr double kTimeTolerance = 5e-3;

std::string script(const BenchMission& mission, const std::string& text) {
  const std::filesystem::path path = mission.path() / "faults.toml";
  std::ofstream(path) << text;
  return path;
}

TEST(SimulatedGigeCamera, GivesEveryPixelInEveryFormat) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(400, 20);  // 20 s: six cameras are opened one after the other
  const std::int64_t start = test::systemUtcNs() + kSecond_ns;
  constexpr std::size_t kEnough = 20;
  const struct {
    CameraSide side;
    const char* format;
  } kCases[] = {{CameraSide::kLeft, "BayerRG12Packed"}, {CameraSide::kLeft, "BayerRG12"},
                {CameraSide::kLeft, "BayerRG12p"},      {CameraSide::kRight, "Mono12Packed"},
                {CameraSide::kRight, "Mono12"},         {CameraSide::kRight, "Mono12p"}};
  std::vector<std::unique_ptr<BenchCamera>> cameras;
  std::vector<std::unique_ptr<BenchClient>> clients;
  std::vector<std::thread> threads;
  for (int n = 0; n < 6; ++n) {
    const auto& c = kCases[n];
    cameras.push_back(std::make_unique<BenchCamera>(n, mission, c.side, start));
    clients.push_back(std::make_unique<BenchClient>(n, mission, c.side, c.format, start));
  }
  for (auto& client : clients)
    threads.emplace_back([&] {
      while (client->frames.size() < kEnough && test::systemUtcNs() < start + 20 * kSecond_ns)
        client->pollFor(0.1);
    });
  for (std::thread& thread : threads) thread.join();
  for (int n = 0; n < 6; ++n) {
    SCOPED_TRACE(kCases[n].format);
    BenchClient& client = *clients[static_cast<std::size_t>(n)];
    EXPECT_EQ(client.wrong, 0);
    if (test::sanitized()) continue;  // too slow for six cameras at once
    EXPECT_GE(client.frames.size(), kEnough) << client.camera().lastFailure();
    EXPECT_EQ(client.count("missed"), 0u);
    EXPECT_LT(client.worst_s, kTimeTolerance);
    EXPECT_EQ(client.camera().serial(), BenchCamera::serial(n));
    EXPECT_GT(client.camera().packetSize(), 8000);  // found by test packets
    EXPECT_EQ(client.camera().pool().held(), 0u);
  }
}

TEST(SimulatedGigeCamera, LosesOnlyWhatIsInjectedAndCountsIt) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(90, 20);  // 4.5 s
  const std::int64_t start = test::systemUtcNs() + 5 * kSecond_ns;
  const std::string faults = script(mission, R"(
[[fault]]
kind = "lost_packets"
at_s = 0.5
for_s = 1
camera = "left"
every = 4
packets = 1
[[fault]]
kind = "lost_packets"
at_s = 1.5
for_s = 1
camera = "left"
every = 4
packets = 1
resend = true
[[fault]]
kind = "lost_frames"
at_s = 2.7
for_s = 0.5
camera = "left"
every = 5
[[fault]]
kind = "id_wrap"
at_s = 3.5
camera = "left"
)");
  BenchCamera camera(0, mission, CameraSide::kLeft, start, {"--faults", faults, "--clock-ppm", "80"});
  // Small packets, as a frame has many: how many may be asked for again goes by how many there are.
  BenchClient client(0, mission, CameraSide::kLeft, "BayerRG12Packed", start, 576);
  client.pollUntil(start + 5 * kSecond_ns);

  EXPECT_EQ(client.wrong, 0);
  EXPECT_LT(client.worst_s, kTimeTolerance);
  EXPECT_EQ(client.count("incomplete") + client.count("timed_out"), 5u);
  EXPECT_EQ(camera.count("lost"), 2);
  EXPECT_EQ(client.count("missed"), 2u);
  EXPECT_EQ(client.count("id_jumps"), 0u);  // a wrap is none
  EXPECT_EQ(client.frames.size(), 90u - 5u - 2u);
  for (std::size_t i = 1; i < client.frames.size(); ++i)
    EXPECT_EQ(client.frames[i].frame_id - client.frames[i - 1].frame_id,
              static_cast<std::uint64_t>(client.indices[i] - client.indices[i - 1]))
        << "image " << client.indices[i];
  EXPECT_GT(client.frames.back().frame_id, 65535u);
  EXPECT_EQ(client.count("stale"), 0u);
  EXPECT_EQ(client.count("clock_resets"), 0u);
  EXPECT_EQ(client.camera().health().disconnects, 0u);
}

TEST(SimulatedGigeCamera, IsFoundAgainAfterARestartWithItsTimesRight) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(140, 20);  // 7 s
  const std::int64_t start = test::systemUtcNs() + 3 * kSecond_ns;
  const std::string faults = script(mission, R"(
[[fault]]
kind = "camera_reboot"
at_s = 1
for_s = 1
camera = "right"
)");
  BenchCamera camera(0, mission, CameraSide::kRight, start,
                     {"--faults", faults, "--clock-offset", "5000", "--frame-id-start", "65500"});
  BenchClient client(0, mission, CameraSide::kRight, "Mono12Packed", start);
  client.pollUntil(start + 75 * kSecond_ns / 10);

  EXPECT_EQ(client.wrong, 0);
  EXPECT_LT(client.worst_s, kTimeTolerance);
  EXPECT_EQ(client.camera().health().disconnects, 1u);
  EXPECT_EQ(client.count("control_lost") + client.count("stalled"), 1u);
  EXPECT_EQ(client.count("clock_resets"), 1u);
  EXPECT_EQ(client.indices.back(), 139);
  // Outage for 1 s, and found within 4 s of its return.
  EXPECT_GT(client.frames.size(), 140u - 20 * 5u);
  for (std::size_t i = 1; i < client.frames.size(); ++i) {
    EXPECT_GT(client.frames[i].frame_id, client.frames[i - 1].frame_id);
    EXPECT_GT(client.frames[i].utc_ns, client.frames[i - 1].utc_ns);
  }
}

TEST(SimulatedGigeCamera, ComesBackWhenItsCableIsPulledAndPutBack) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(150, 20);  // 7.5 s
  const std::int64_t start = test::systemUtcNs() + 3 * kSecond_ns;
  BenchCamera camera(0, mission, CameraSide::kLeft, start);
  BenchClient client(0, mission, CameraSide::kLeft, "BayerRG12Packed", start);
  client.pollUntil(start + kSecond_ns);
  const std::size_t before = client.frames.size();
  EXPECT_GT(before, 15u);
  camera.process().unplug();
  client.pollFor(2.5);
  EXPECT_LE(client.frames.size(), before + 2);
  EXPECT_FALSE(client.camera().health().open);
  camera.process().plug();
  client.pollUntil(start + 8 * kSecond_ns);

  EXPECT_EQ(client.wrong, 0);
  EXPECT_LT(client.worst_s, kTimeTolerance);
  EXPECT_EQ(client.camera().health().disconnects, 1u);
  EXPECT_EQ(client.count("clock_resets"), 0u);  // its clock continued
  EXPECT_EQ(client.indices.back(), 149);
}

TEST(SimulatedGigeCamera, IsOpenedAgainWhenItRunsFreeAndNeverBegins) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(20, 20);
  const std::int64_t start = test::systemUtcNs() + 10 * kSecond_ns;  // its first exposure
  BenchCamera free(0, mission, CameraSide::kLeft, start), line(1, mission, CameraSide::kRight, start);
  BenchClient by_itself(0, mission, CameraSide::kLeft, "BayerRG12Packed", start);
  BenchClient by_line(1, mission, CameraSide::kRight, "Mono12Packed", start, 0, io::CameraTrigger::kLine);
  std::thread other([&] { by_line.pollUntil(start + 12 * kSecond_ns / 10); });
  by_itself.pollUntil(start + 12 * kSecond_ns / 10);
  other.join();
  EXPECT_EQ(by_itself.count("no_first_frame"), 1u) << by_itself.camera().lastFailure();
  EXPECT_GT(by_itself.frames.size(), 0u) << "it gives its frames to the second opening";
  EXPECT_EQ(by_itself.wrong, 0);
  EXPECT_EQ(by_line.count("no_first_frame"), 0u) << "its trigger may not run yet";
  EXPECT_EQ(by_line.camera().health().disconnects, 0u);
  EXPECT_GT(by_line.frames.size(), 0u);
}

TEST(SimulatedGigeCamera, IsTriggeredByALineOrSetByPtp) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(100, 20);
  const std::int64_t start = test::systemUtcNs() + kSecond_ns;
  BenchCamera line(0, mission, CameraSide::kLeft, start), ptp(1, mission, CameraSide::kRight, start);
  BenchClient by_line(0, mission, CameraSide::kLeft, "BayerRG12Packed", start, 8000,
                      io::CameraTrigger::kLine);
  BenchClient by_ptp(1, mission, CameraSide::kRight, "Mono12Packed", start, 8000, io::CameraTrigger::kPtp);
  std::thread other([&] { by_ptp.pollUntil(start + 52 * kSecond_ns / 10); });
  by_line.pollUntil(start + 52 * kSecond_ns / 10);
  other.join();
  for (BenchClient* client : {&by_line, &by_ptp}) {
    EXPECT_GT(client->frames.size(), 20u) << client->camera().lastFailure();
    EXPECT_EQ(client->wrong, 0);
    EXPECT_LT(client->worst_s, kTimeTolerance);
  }
  EXPECT_EQ(by_ptp.count("ptp_apart"), 0u);
  EXPECT_LT(by_ptp.worst_s, 1e-3);  // no estimate of ours
}

TEST(SimulatedGigeCamera, LeavesOutNewFramesWhenNobodyGivesBlocksBack) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const BenchMission mission(40, 20);
  const std::int64_t start = test::systemUtcNs() + 3 * kSecond_ns;
  BenchCamera camera(0, mission, CameraSide::kLeft, start);
  BenchClient client(0, mission, CameraSide::kLeft, "BayerRG12Packed", start);
  std::vector<std::uint32_t> hoard;
  for (std::uint32_t block = client.camera().pool().acquire(); block != rt::SharedBlocks::kNone;
       block = client.camera().pool().acquire())
    hoard.push_back(block);
  client.pollUntil(start + kSecond_ns);
  EXPECT_TRUE(client.frames.empty());
  EXPECT_GT(client.count("pool_full"), 10u);
  for (const std::uint32_t block : hoard) client.camera().pool().release(block);
  client.pollUntil(start + 25 * kSecond_ns / 10);
  EXPECT_EQ(client.wrong, 0);
  EXPECT_EQ(client.frames.size() + client.count("pool_full"), 40u);
}

}  // namespace
}  // namespace fathom
