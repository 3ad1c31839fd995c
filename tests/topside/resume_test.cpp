#include <gmock/gmock.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "recon/topside/pipeline.hpp"
#include "recon/topside/work/stage_store.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "tests/support/test_data.hpp"
#include "tests/world/missions.hpp"

namespace fathom::topside {
namespace {

using ::testing::HasSubstr;

namespace fs = std::filesystem;

// A track of some tiles' length in several pieces.
TopsideConfig inPieces() {
  TopsideConfig config;
  config.model.division.target_meshes = 8;
  config.model.division.max_meshes = 12;
  return config;
}

nlohmann::json reportOf(const fs::path& folder) {
  std::ifstream in(folder / "report.json");
  return nlohmann::json::parse(in);
}

std::size_t madeIn(const nlohmann::json& report, const std::string& stage) {
  return report.at("times").at("stages").at(stage).at("made").get<std::size_t>();
}

fs::path workFile(const fs::path& stage, std::size_t number) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(stage))
    if (entry.path().extension() == ".work") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files.at(number);
}

class Resume : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    test::TinyMission scene{.pairs = 36, .speed = 1.0};
    folder_ = std::make_unique<test::TemporaryFolder>();
    scene.write(folder_->path() / "mission");
    done_ = std::make_unique<Summary>(runTopside(placesFor("first"), inPieces()));
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static RunPlaces placesFor(const std::string& name) {
    RunPlaces places;
    places.mission = folder_->path() / "mission";
    places.out = folder_->path() / name;
    places.work = folder_->path() / (name + ".work");
    return places;
  }
  inline static std::unique_ptr<test::TemporaryFolder> folder_;
  inline static std::unique_ptr<Summary> done_;
};

TEST_F(Resume, OneThreadGivesTheBytesThatManyGive) {
  TopsideConfig config = inPieces();
  config.threads = 1;
  EXPECT_EQ(runTopside(placesFor("one-thread"), config).content, done_->content);
}

TEST_F(Resume, ARunOfFinishedWorkMakesNothingAndGivesTheSameBytes) {
  RunPlaces places = placesFor("first");
  EXPECT_EQ(runTopside(places, inPieces()).content, done_->content);
  const auto report = reportOf(places.out);
  for (const auto& [stage, line] : report.at("times").at("stages").items())
    if (stage != "assemble") {
      EXPECT_EQ(line.at("made"), 0) << stage;
    }
}

TEST_F(Resume, KilledAtAnyMomentTheNextRunGivesTheSameBytes) {
  const RunPlaces places = placesFor("killed");
  std::mt19937 random(7);  // of delays alone: whatever the moment, the bytes must be the same
  for (int kill = 0; kill < 3; ++kill) {
    sim::ChildProcess program({{FATHOM_BIN_DIR "/fathom-topside", "run", places.mission.string(), "--work",
                                places.work.string(), "--out", places.out.string()},
                               {},
                               "/dev/null",
                               {}});
    std::this_thread::sleep_for(std::chrono::milliseconds(200 + random() % 2500));
    program.signal(SIGKILL);
    ASSERT_TRUE(program.wait(10));
  }
  RunPlaces whole = placesFor("whole");
  EXPECT_EQ(runTopside(places, {}).content, runTopside(whole, {}).content);
  EXPECT_FALSE(fs::exists(places.out.string() + ".tmp"));
}

TEST_F(Resume, AFlippedBitInTheWorkIsNoticedAndTheResultMadeAgain) {
  const RunPlaces places = placesFor("flipped");
  (void)runTopside(places, inPieces());
  for (const char* stage : {"prepare", "piece", "level1", "localise"}) {
    const fs::path path = workFile(places.work / stage, 0);
    std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
    const auto middle = static_cast<std::streamoff>(fs::file_size(path) / 2);
    file.seekg(middle);
    const int byte = file.get() ^ 4;
    file.seekp(middle);
    file.put(static_cast<char>(byte));
  }
  EXPECT_EQ(runTopside(places, inPieces()).content, done_->content);
  const auto report = reportOf(places.out);
  EXPECT_EQ(report.at("work_files_damaged"), 4);
  EXPECT_EQ(madeIn(report, "piece"), 1u);
}

TEST_F(Resume, AChangedPoseMakesOnlyThePiecesThatItTouches) {
  RunPlaces places = placesFor("poses");
  places.input.poses = folder_->path() / "poses.data";
  io::StereoPoseFile poses = io::readStereoPoses(folder_->path() / "first" / "stereo_pose_est.data");
  io::writeStereoPoses(places.input.poses, poses);
  (void)runTopside(places, inPieces());
  const std::size_t pieces = madeIn(reportOf(places.out), "piece");
  ASSERT_GE(pieces, 4u);

  poses.poses.back().T_nav_cam =
      SE3(Eigen::Quaterniond::Identity(), {0, 0, 0.004}) * poses.poses.back().T_nav_cam;
  io::writeStereoPoses(places.input.poses, poses);
  (void)runTopside(places, inPieces());
  const auto report = reportOf(places.out);
  EXPECT_GE(madeIn(report, "piece"), 1u);
  EXPECT_LE(madeIn(report, "piece"), pieces / 2);
  EXPECT_EQ(madeIn(report, "prepare"), 0u);
}

TEST_F(Resume, StagesAndPiecesByThemselvesGiveTheBytesOfARun) {
  const RunPlaces places = placesFor("stages");
  const TopsideConfig config = inPieces();
  EXPECT_THROW(runOneStage(places, config, Stage::kPlan, {}), InputError);
  for (const Stage stage :
       {Stage::kSurvey, Stage::kLighting, Stage::kPrepare, Stage::kLocalise, Stage::kPlan})
    runOneStage(places, config, stage, {});
  const auto items = nlohmann::json::parse(listItems(places, config));
  EXPECT_EQ(items.at("prepare"), 2);
  const auto pieces = items.at("piece").get<std::size_t>();
  ASSERT_GE(pieces, 4u);
  for (std::size_t piece = pieces; piece-- > 0;)
    runOneStage(places, config, Stage::kPiece, std::pair(piece, piece + 1));
  EXPECT_THROW(runOneStage(places, config, Stage::kPiece, std::pair(pieces, pieces + 1)), InputError);
  runOneStage(places, config, Stage::kLevel, {});
  EXPECT_EQ(runTopside(places, config).content, done_->content);
  EXPECT_EQ(madeIn(reportOf(places.out), "piece"), 0u);
}

TEST_F(Resume, ImagesWithCalibrationAndPosesAloneAreEnough) {
  const fs::path bare = folder_->path() / "acfr";
  fs::create_directories(bare);
  fs::create_directory_symlink(folder_->path() / "mission" / "img", bare / "i20231114");
  fs::copy(folder_->path() / "mission" / "stereo.calib", bare / "ng2.calib");
  fs::copy(folder_->path() / "first" / "stereo_pose_est.data", bare);
  RunPlaces places = placesFor("bare");
  places.mission = bare;
  const Summary done = runTopside(places, inPieces());
  EXPECT_EQ(done.used, 36u);
  EXPECT_NEAR(done.area, done_->area, 0.05 * done_->area);
  EXPECT_THAT(reportOf(places.out).at("assumed").dump(), HasSubstr("no mission.toml"));
  fs::remove(bare / "ng2.calib");
  EXPECT_THROW((void)runTopside(places, inPieces()), InputError);
}

TEST_F(Resume, AFolderThatIsNoWorkFolderIsLeftAlone) {
  RunPlaces places = placesFor("thesis");
  fs::create_directories(places.work);
  std::ofstream(places.work / "thesis.tex") << "years of work";
  EXPECT_THROW((void)runTopside(places, inPieces()), InputError);
  EXPECT_TRUE(fs::exists(places.work / "thesis.tex"));
}

using Access = StageStore::Access;

Digest keyOf(int n) {
  return Hasher().add(n).finish();
}

fs::path fileOf(const fs::path& stage) {
  for (const auto& entry : fs::directory_iterator(stage))
    if (entry.path().extension() == ".work") return entry.path();
  return {};
}

class Work : public ::testing::Test {
 protected:
  void write(StageStore& store, const Digest& key) const {
    WorkFileWriter file = store.writer("piece", "3", key);
    file.add("mesh", mesh_);
    file.add("empty", {});
    file.commit();
    store.written("piece", "3", key, {{"seconds", 1.5}});
  }
  test::TemporaryFolder place_;
  fs::path folder_ = place_.path() / "topside.work";
  Bytes mesh_ = {1, 2, 3, 250, 0, 7};
};

TEST_F(Work, AResultIsReadAsItWasWrittenAndOnlyUnderItsKey) {
  {
    StageStore store(folder_, Access::kAlone);
    EXPECT_FALSE(store.find("piece", "3", keyOf(1)));
    write(store, keyOf(1));
  }
  StageStore store(folder_, Access::kShared);
  const auto found = store.find("piece", "3", keyOf(1));
  ASSERT_TRUE(found);
  EXPECT_EQ(found->read("mesh"), mesh_);
  EXPECT_EQ(found->digestOf("mesh"), digestOf(mesh_));
  EXPECT_TRUE(found->read("empty").empty());
  EXPECT_THROW((void)found->read("texture"), DamagedWork);
  EXPECT_FALSE(store.find("piece", "3", keyOf(2)));
  EXPECT_EQ(store.costs("piece").at("3").at("seconds"), 1.5);
}

TEST_F(Work, AnyFlippedBitIsNoticedAndTheFileIsGone) {
  std::size_t size = 1;
  for (std::size_t at = 0; at < size; ++at) {
    {
      StageStore store(folder_, Access::kAlone);
      write(store, keyOf(1));
    }
    const fs::path path = fileOf(folder_ / "piece");
    size = fs::file_size(path);
    {
      std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
      file.seekg(static_cast<std::streamoff>(at));
      const int byte = file.get() ^ (1 << at % 8);
      file.seekp(static_cast<std::streamoff>(at));
      file.put(static_cast<char>(byte));
    }
    StageStore store(folder_, Access::kAlone);
    EXPECT_FALSE(store.find("piece", "3", keyOf(1))) << "byte " << at;
    EXPECT_EQ(store.damaged(), 1u);
    EXPECT_FALSE(fs::exists(path));
  }
}

TEST_F(Work, AFileCutAnywhereIsNoResult) {
  StageStore store(folder_, Access::kAlone);
  write(store, keyOf(1));
  const fs::path path = fileOf(folder_ / "piece");
  for (auto size = fs::file_size(path); size-- > 0;) {
    fs::resize_file(path, size);
    EXPECT_FALSE(WorkFile::open(path, keyOf(1)).has_value()) << size;
  }
}

TEST_F(Work, ANewResultTakesThePlaceOfTheOldOneOfItsItem) {
  StageStore store(folder_, Access::kAlone);
  write(store, keyOf(1));
  write(store, keyOf(2));
  EXPECT_FALSE(store.find("piece", "3", keyOf(1)));
  EXPECT_TRUE(store.find("piece", "3", keyOf(2)));
}

TEST_F(Work, WhatAKilledProcessLeftIsSweptByTheNextThatIsAlone) {
  fs::path left;
  {
    StageStore store(folder_, Access::kAlone);
    write(store, keyOf(1));
    left = folder_ / "piece" / "4-0123456789abcdef.work.host.1.tmp";
    std::ofstream(left) << "half";
  }
  { StageStore store(folder_, Access::kShared); }
  EXPECT_TRUE(fs::exists(left));
  { StageStore store(folder_, Access::kAlone); }
  EXPECT_FALSE(fs::exists(left));
}

TEST_F(Work, TwoRunsDoNotWorkInOneFolderAndAForeignFolderIsRefused) {
  StageStore first(folder_, Access::kShared);
  { StageStore second(folder_, Access::kShared); }
  EXPECT_THROW(StageStore(folder_, Access::kAlone), InputError);
  std::ofstream(place_.path() / "thesis.tex") << "years of work";
  EXPECT_THROW(StageStore(place_.path(), Access::kAlone), InputError);
}

TEST(Digests, AreBlake2bAndTellListsOfTextsApart) {
  // BLAKE2b-256 of nothing, as its authors' tools give it.
  EXPECT_EQ(digestOf({}).hex(), "0e5751c026e543b2e8ab2eb06099daa1d1e5df47778f7787faab45cdf12fe3a8");
  EXPECT_NE(Hasher().add("ab", "c").finish(), Hasher().add("a", "bc").finish());
}

}  // namespace
}  // namespace fathom::topside
