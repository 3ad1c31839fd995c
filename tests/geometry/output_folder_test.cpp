#include "realtime/base/files/output_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr std::array<std::string_view, 2> kOurs = {"mesh.ply", "layers/@(slope|views).tif"};

bool cannotExchange(const fs::path&, const fs::path&) {
  return false;
}

class OutputFolderTest : public ::testing::Test {
 protected:
  void SetUp() override { test::writeText(out_ / "mesh.ply", "old"); }
  [[nodiscard]] std::string refused() const {
    return test::refusal([&] { const OutputFolder folder(out_, kOurs); });
  }
  void makeNew(const OutputFolder::Exchange& exchange) const {
    OutputFolder folder(out_, kOurs);
    test::writeText(folder.path() / "mesh.ply", "new");
    folder.commit(exchange);
  }

  test::TemporaryFolder scratch_;
  fs::path out_ = scratch_.path() / "topside", temporary_ = scratch_.path() / "topside.tmp",
           aside_ = scratch_.path() / "topside.old.tmp";
};

TEST_F(OutputFolderTest, AForeignFileAtAnyDepthIsNamedAndStays) {
  test::writeText(out_ / "layers/slope.tif", "old");
  EXPECT_EQ(refused(), "");
  for (const char* name : {"notes.txt", "layers/mine.tif", "layers/slope.tif.aux.xml", "layers/.hidden",
                           "layers/deep/er/slope.tif", "mesh.ply/thesis.tex"}) {
    if (fs::path(name).begin()->string() == "mesh.ply") fs::remove(out_ / "mesh.ply");
    test::writeText(out_ / name, "years of work");
    EXPECT_THAT(refused(), HasSubstr(name));
    EXPECT_EQ(test::readText(out_ / name), "years of work");
    fs::remove(out_ / name);
  }
}

TEST_F(OutputFolderTest, ALinkIsAForeignFile) {
  fs::create_directories(scratch_.path() / "elsewhere");
  fs::create_directory_symlink(scratch_.path() / "elsewhere", out_ / "layers");
  EXPECT_THAT(refused(), HasSubstr("layers"));
}

TEST_F(OutputFolderTest, AForeignFileThatCameMeanwhileStaysToo) {
  EXPECT_THAT(test::refusal([&] {
                OutputFolder folder(out_, kOurs);
                test::writeText(folder.path() / "mesh.ply", "new");
                test::writeText(out_ / "layers/notes.txt", "years of work");
                folder.commit();
              }),
              HasSubstr("layers/notes.txt"));
  EXPECT_EQ(test::readText(out_ / "layers/notes.txt"), "years of work");
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "old");
}

TEST_F(OutputFolderTest, TheNewOneTakesTheOldOnesPlaceWithAndWithoutExchange) {
  makeNew(cannotExchange);
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "new");
  test::writeText(out_ / "mesh.ply", "old");
  OutputFolder folder(out_, kOurs);
  test::writeText(folder.path() / "mesh.ply", "newer");
  folder.commit();
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "newer");
  EXPECT_FALSE(fs::exists(aside_));
}

TEST_F(OutputFolderTest, WhereFoldersCannotBeExchangedTheOldOneIsNeverGoneBeforeTheNewOneStands) {
  // The new name is taken, so that the step after the failed exchange fails.
  EXPECT_ANY_THROW(makeNew([&](const fs::path&, const fs::path&) {
    test::writeText(aside_ / "blocked", "");
    return false;
  }));
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "old");
}

TEST_F(OutputFolderTest, ARunKilledBetweenTheStepsOfAnExchangeLosesNothing) {
  fs::rename(out_, aside_);
  test::writeText(temporary_ / "mesh.ply", "new");
  { const OutputFolder next(out_, kOurs); }
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "old");
  EXPECT_FALSE(fs::exists(aside_));

  test::writeText(aside_ / "mesh.ply", "older");  // killed before it was deleted
  { const OutputFolder next(out_, kOurs); }
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "old");
  EXPECT_FALSE(fs::exists(aside_));
}

TEST_F(OutputFolderTest, ASecondProgramIsRefusedAndTheFirstKeepsItsWork) {
  OutputFolder first(out_, kOurs);
  test::writeText(first.path() / "mesh.ply", "new");
  EXPECT_THAT(refused(), HasSubstr("is being written by another program"));
  EXPECT_EQ(test::readText(temporary_ / "mesh.ply"), "new");
  first.commit();
  EXPECT_THAT(refused(), HasSubstr("is being written by another program")) << "until the old one is gone";
  EXPECT_EQ(test::readText(out_ / "mesh.ply"), "new");
}

TEST_F(OutputFolderTest, ForeignFilesUnderTheTemporaryNamesAreNamedAndStay) {
  for (const fs::path& folder : {temporary_, aside_}) {
    test::writeText(folder / "notes.txt", "years of work");
    EXPECT_THAT(refused(), HasSubstr(folder.filename().string() + ": notes.txt"));
    EXPECT_EQ(test::readText(folder / "notes.txt"), "years of work");
    fs::remove_all(folder);
  }
  test::writeText(temporary_ / "layers/slope.tif", "half");  // of a program that was killed
  test::writeText(temporary_ / "layers/slope.tmp.tif", "half");
  EXPECT_EQ(refused(), "");
  EXPECT_FALSE(fs::exists(temporary_));
}

TEST_F(OutputFolderTest, BehindALinkTheFolderIsReplacedAndTheLinkStays) {
  const test::TemporaryFolder large_disk;
  const fs::path real = large_disk.path() / "results";
  fs::remove_all(out_);
  fs::create_directory_symlink(real, out_);
  for (const char* text : {"first", "second"}) {
    OutputFolder folder(out_, kOurs);
    EXPECT_EQ(folder.path().parent_path(), large_disk.path());
    test::writeText(folder.path() / "mesh.ply", text);
    folder.commit();
    EXPECT_TRUE(fs::is_symlink(out_));
    EXPECT_EQ(test::readText(real / "mesh.ply"), text);
  }
}

TEST_F(OutputFolderTest, WorkThatOutlivesItsProgramIsThereUntilItStandsInItsPlace) {
  EXPECT_ANY_THROW({
    OutputFolder folder(out_, kOurs, {.outlives = true, .reopen = false});
    test::writeText(folder.path() / "mesh.ply", "new");
    folder.commit([&](const fs::path&, const fs::path&) {
      test::writeText(aside_ / "blocked", "");
      return false;
    });
  });
  EXPECT_EQ(test::readText(temporary_ / "mesh.ply"), "new");
}

}  // namespace
}  // namespace fathom
