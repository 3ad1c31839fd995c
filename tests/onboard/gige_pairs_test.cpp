// Two cameras over real GVCP and GVSP, with every fault that a camera has, and the pairing behind them.
#include <algorithm>
#include <mutex>
#include <set>
#include <sstream>

#include "realtime/onboard/nav/nav_core.hpp"
#include "tests/sim/gige_bench.hpp"
#include "tests/support/heap_counter.hpp"

namespace fathom::onboard {
namespace {

using test::BenchClient;

constexpr std::int64_t kSecond = 1'000'000'000, kMs = 1'000'000;
constexpr double kRateHz = 25;
constexpr std::int64_t kTolerance = 8 * kMs;

constexpr const char* kFaults = R"(
[[fault]]
kind = "lost_packets"
at_s = 0.5
for_s = 1
camera = "left"
every = 3
packets = 2
[[fault]]
kind = "lost_packets"
at_s = 1
for_s = 1
camera = "right"
every = 4
packets = 3
resend = true
[[fault]]
kind = "lost_frames"
at_s = 2
for_s = 1
camera = "both"
every = 3
[[fault]]
kind = "skew"
at_s = 3.2
for_s = 1
camera = "right"
offset_s = 0.012
[[fault]]
kind = "id_wrap"
at_s = 4.5
camera = "both"
[[fault]]
kind = "camera_reboot"
at_s = 5
for_s = 1
camera = "right"
[[fault]]
kind = "lost_frames"
at_s = 10.5
for_s = 0.5
camera = "left"
every = 2
)";

// Exposures that reached the client's network whole and on time, by the camera's own log.
std::set<int> given(const test::BenchMission& mission, int camera) {
  std::ifstream in(mission.path() / ("camera" + std::to_string(camera) + ".csv"));
  std::set<int> numbers;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::array<std::string, 10> fields;
    std::istringstream words(line);
    for (std::string& field : fields) std::getline(words, field, ',');
    if (fields[6] == "sent" && fields[8] == "0" && fields[9] == "0") numbers.insert(std::stoi(fields[0]));
  }
  return numbers;
}

TEST(GigePairs, AreOfOneMomentThroughEveryFaultOfACamera) {
  if (const std::string why = test::ownNetwork(); !why.empty()) GTEST_SKIP() << why;
  const test::BenchMission mission(300, kRateHz);  // 12 s
  const std::filesystem::path script = mission.path() / "faults.toml";
  std::ofstream(script) << kFaults;
  const std::int64_t start = test::systemUtcNs() + 6 * kSecond;
  test::BenchCamera left_camera(0, mission, CameraSide::kLeft, start,
                                {"--faults", script, "--clock-ppm", "70", "--clock-offset", "900"});
  test::BenchCamera right_camera(1, mission, CameraSide::kRight, start,
                                 {"--faults", script, "--clock-ppm", "-50"});
  BenchClient left(0, mission, CameraSide::kLeft, "BayerRG12Packed", start, 1000);
  BenchClient right(1, mission, CameraSide::kRight, "Mono12Packed", start, 1000);

  std::mutex one;
  StereoPairing pairing(kTolerance);
  std::vector<StereoPairing::Pair> pairs;
  const auto run = [&](BenchClient& client, CameraSide side) {
    std::size_t seen = 0;
    while (test::systemUtcNs() < start + 125 * kSecond / 10) {
      client.pollFor(0.01);
      const std::lock_guard lock(one);
      for (; seen < client.frames.size(); ++seen)
        if (const auto pair = pairing.add(
                side, {client.frames[seen].utc_ns, static_cast<std::uint32_t>(client.indices[seen])}))
          pairs.push_back(*pair);
    }
  };
  std::thread other([&] { run(right, CameraSide::kRight); });
  run(left, CameraSide::kLeft);
  other.join();

  // Every frame is pixel by pixel the image exposed at its time; every pair is of one exposure.
  EXPECT_EQ(left.wrong + right.wrong, 0);
  std::set<int> paired;
  for (const StereoPairing::Pair& pair : pairs) {
    EXPECT_EQ(pair.left.frame_id, pair.right.frame_id);
    paired.insert(static_cast<int>(pair.left.frame_id));
  }
  if (test::sanitized()) GTEST_SKIP() << "a sanitizer is too slow for every frame; pairs are of one exposure";
  const std::set<int> left_given = given(mission, 0), right_given = given(mission, 1);
  std::vector<int> both, missing;
  std::set_intersection(left_given.begin(), left_given.end(), right_given.begin(), right_given.end(),
                        std::back_inserter(both));
  std::set_difference(both.begin(), both.end(), paired.begin(), paired.end(), std::back_inserter(missing));
  EXPECT_GT(both.size(), 120u);
  // Nothing that both gave is lost but at most a frame where the right camera comes back.
  EXPECT_LE(missing.size(), 1u) << "first " << (missing.empty() ? -1 : missing[0]);

  EXPECT_EQ(left.count("incomplete") + left.count("timed_out"), 9u);
  EXPECT_EQ(right.count("incomplete") + right.count("timed_out"), 0u);
  EXPECT_EQ(left.count("missed"), static_cast<std::uint64_t>(left_camera.count("lost")));
  EXPECT_EQ(left.count("id_jumps") + right.count("id_jumps"), 0u);
  EXPECT_EQ(left.camera().health().disconnects, 0u);
  EXPECT_EQ(right.camera().health().disconnects, 1u);
  EXPECT_EQ(right.count("clock_resets"), 1u);
  // 25 exposures 12 ms late have no partner within 8 ms.
  EXPECT_GE(pairing.unpaired(CameraSide::kLeft), 25u);
}

}  // namespace
}  // namespace fathom::onboard
