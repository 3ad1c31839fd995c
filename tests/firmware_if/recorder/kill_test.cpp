// A recorder that is killed at any instant.
#include <gmock/gmock.h>
#include <signal.h>

#include <chrono>
#include <random>
#include <thread>

#include "sim/hil/bench/child_process.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

TEST(RecorderKilled, LosesNothingThatItHadHandedToTheSystem) {
  constexpr int kKills = 8;
  constexpr std::int64_t kMostLostMs = 1000;
  TemporaryFolder parent;
  const auto folder = parent.path() / "dive", status_file = parent.path() / "status";
  const SyntheticDive dive({160, 120, 50});
  std::mt19937 random(20261121);
  std::uint64_t before = 0;
  for (int kill = 0; kill < kKills; ++kill) {
    sim::ChildProcess recorder({{FATHOM_BIN_DIR "/dive_recorder", folder.string(), "--width", "160",
                                 "--height", "120", "--speed", "5"},
                                {},
                                status_file,
                                {}});
    std::this_thread::sleep_for(std::chrono::milliseconds(150 + random() % 1500));
    recorder.signal(SIGKILL);
    ASSERT_EQ(recorder.wait(10), 128 + SIGKILL);
    if (!std::filesystem::exists(io::MissionPaths(folder).log())) continue;  // killed as it began
    if (std::filesystem::file_size(io::MissionPaths(folder).log()) == 0) continue;
    const RecorderStatus status(readText(status_file));
    const SyntheticDive::Found found = dive.check(folder);
    EXPECT_THAT(found.wrong, ::testing::IsEmpty());
    EXPECT_EQ(found.skipped % SyntheticDive::kRestartInputs, 0u);
    EXPECT_EQ(found.images_lost, 0u);
    EXPECT_GE(found.next, status.safe());
    EXPECT_GE(found.next, status.offeredBefore(kMostLostMs));
    EXPECT_GE(found.next, before);
    before = found.next;
  }
  EXPECT_GT(before, 500u);
}

}  // namespace
}  // namespace fathom::test
