// A recorder that is killed at any instant.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <random>
#include <thread>

#include "tests/firmware_if/recorder/recorder_status.hpp"
#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/files.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

using ::testing::IsEmpty;

pid_t startRecorder(const std::filesystem::path& folder, const std::filesystem::path& status) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  const int out = ::open(status.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  ::dup2(out, STDOUT_FILENO);
  ::execl(FATHOM_BIN_DIR "/dive_recorder", "dive_recorder", folder.c_str(), "--width", "160", "--height",
          "120", "--speed", "5", nullptr);
  ::_exit(127);
}

TEST(RecorderKilled, LosesNothingThatItHadHandedToTheSystem) {
  constexpr int kKills = 8;
  constexpr std::int64_t kMostLostMs = 1000;
  TemporaryFolder parent;
  const auto folder = parent.path() / "dive", status_file = parent.path() / "status";
  const SyntheticDive dive({160, 120, 50});
  std::mt19937 random(20261121);
  std::uint64_t before = 0;
  for (int kill = 0; kill < kKills; ++kill) {
    const pid_t child = startRecorder(folder, status_file);
    ASSERT_GT(child, 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(150 + random() % 1500));
    ASSERT_EQ(::kill(child, SIGKILL), 0);
    int result = 0;
    ASSERT_EQ(::waitpid(child, &result, 0), child);
    ASSERT_TRUE(WIFSIGNALED(result));
    if (!std::filesystem::exists(io::MissionPaths(folder).log())) continue;  // killed as it began
    if (std::filesystem::file_size(io::MissionPaths(folder).log()) == 0) continue;
    const RecorderStatus status(readText(status_file));
    const SyntheticDive::Found found = dive.check(folder);
    EXPECT_THAT(found.wrong, IsEmpty());
    EXPECT_EQ(found.skipped % SyntheticDive::kAway, 0u);
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
