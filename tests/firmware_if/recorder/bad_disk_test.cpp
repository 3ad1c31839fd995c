// The bad disk itself, around programs of the system.
#include "tests/support/bad_disk.hpp"

#include <gmock/gmock.h>

#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/program_run.hpp"

namespace fathom::test {
namespace {

using ::testing::HasSubstr;

class BadDiskTest : public ::testing::Test {
 protected:
  // "dd" of 64 KiB in pieces of 4 KiB, synced, under the bad disk.
  Outcome copy(const std::filesystem::path& from, const std::filesystem::path& to) {
    return run("dd bs=4096 count=16 conv=fsync if=" + from.string() + " of=" + to.string());
  }
  Outcome run(const std::string& command) {
    std::string line = "env";
    for (const std::string& variable : disk_.environment()) line += " " + variable;
    return runCommand(line + " LC_ALL=C " + command);
  }

  TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "disk", file_ = folder_ / "file";
  BadDisk disk_{(std::filesystem::create_directory(folder_), folder_)};
};

TEST_F(BadDiskTest, TouchesNothingUntilItIsSetAndNothingElsewhere) {
  EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
  EXPECT_EQ(std::filesystem::file_size(file_), 65536u);
  const auto rule = disk_.set({.fault = DiskFault::kInputOutput});
  EXPECT_EQ(copy("/dev/zero", parent_.path() / "other").exit_code, 0);
  EXPECT_EQ(disk_.hits(rule), 0u);
}

TEST_F(BadDiskTest, SpoilsTheCallsOfAChildAsLongAsItIsSet) {
  struct Case {
    BadDisk::Order order;
    const char* error;
    std::uint64_t hits, bytes;
  };
  for (const Case& c : {
           Case{{.fault = DiskFault::kInputOutput, .calls = kSyncCall}, "Input/output error", 1, 65536},
           Case{{.fault = DiskFault::kNoSpace, .calls = kWriteCall, .after = 3, .times = 1},
                "No space left on device",
                1,
                3 * 4096},
           Case{{.fault = DiskFault::kShortWrite}, "No space left on device", 2, 2048},
           Case{{.fault = DiskFault::kReadOnly}, "Read-only file system", 1, 0},
           Case{{.fault = DiskFault::kInputOutput, .path = "another"}, "", 0, 65536},
           Case{{.fault = DiskFault::kStall, .stall_ms = 1}, "", 0, 65536},
       }) {
    std::filesystem::remove(file_);
    const auto rule = disk_.set(c.order);
    const Outcome outcome = copy("/dev/zero", file_);
    EXPECT_EQ(outcome.exit_code, *c.error == 0 ? 0 : 1) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(c.error));
    if (c.order.fault == DiskFault::kStall)
      EXPECT_GE(disk_.hits(rule), 18u);
    else
      EXPECT_EQ(disk_.hits(rule), c.hits) << outcome.err;
    disk_.clear();
    EXPECT_EQ(std::filesystem::exists(file_) ? std::filesystem::file_size(file_) : 0, c.bytes);
    std::filesystem::remove(file_);
    EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
  }
}

TEST_F(BadDiskTest, SpoilsReadingRenamingAndRemoving) {
  writeText(file_, "text");
  const auto to = (folder_ / "to").string();
  disk_.set({.fault = DiskFault::kInputOutput, .calls = kReadCall});
  EXPECT_THAT(run("dd status=none if=" + file_.string()).err, HasSubstr("Input/output error"));
  disk_.clear();
  EXPECT_EQ(run("dd status=none if=" + file_.string()).out, "text");
  disk_.set({.fault = DiskFault::kReadOnly});
  EXPECT_THAT(run("mv " + file_.string() + " " + to).err, HasSubstr("Read-only file system"));
  EXPECT_THAT(run("rm " + file_.string()).err, HasSubstr("Read-only file system"));
  EXPECT_THAT(run("mkdir " + to).err, HasSubstr("Read-only file system"));
  EXPECT_EQ(run("dd status=none if=" + file_.string()).out, "text");
}

TEST_F(BadDiskTest, SpoilsAProgramOfOursWhileItRuns) {
  const auto rule = disk_.set({.fault = DiskFault::kReadOnly, .path = "sensors.lcmlog", .for_ms = 300});
  const Outcome outcome =
      run(FATHOM_BIN_DIR "/dive_recorder " + (folder_ / "dive").string() + " --seconds 0.6 --speed 2");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_GT(disk_.hits(rule), 0u);
  const SyntheticDive::Found found = SyntheticDive({}).check(folder_ / "dive");
  EXPECT_THAT(found.wrong, ::testing::IsEmpty());
  EXPECT_GT(found.inputs, 50u);
  EXPECT_EQ(found.skipped, 0u);
  EXPECT_GT(found.images_lost, 0u);
}

TEST_F(BadDiskTest, EndsByItselfWhenItsTimeIsOver) {
  disk_.set({.fault = DiskFault::kReadOnly, .for_ms = 1});
  ::usleep(2000);
  EXPECT_EQ(copy("/dev/zero", file_).exit_code, 0);
}

}  // namespace
}  // namespace fathom::test
