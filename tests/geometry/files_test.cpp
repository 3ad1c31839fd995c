#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <array>
#include "realtime/base/files/output_folder.hpp"
#include "recon/geometry/ply.hpp"
#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

using test::TemporaryFolder, ::testing::HasSubstr;

Mesh square() {
  Mesh mesh;
  mesh.vertices = {{0, 0, 1}, {1, 0, 1}, {1, 1, 1.5f}, {0, 1, 1}};
  mesh.normals.assign(4, {0, 0, -1});
  mesh.colours = {Rgb{1, 2, 3}, Rgb{4, 5, 6}, Rgb{250, 251, 252}, Rgb{0, 0, 0}};
  mesh.texture_coordinates = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.sigma = {0.01f, 0.02f, 0.03f, 0.04f};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

std::filesystem::path plyFile(const TemporaryFolder& folder, const std::string& text) {
  const auto path = folder.path() / "m.ply";
  test::writeText(path, text);
  return path;
}

std::string plyRefusal(const std::filesystem::path& path) {
  return test::refusal([&] { (void)readPly(path); });
}

TEST(Ply, EveryAttributeRoundTrips) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "square.ply";
  const Mesh out = square();
  writePly(path, out, {"frame nav"});
  const Mesh in = readPly(path);
  EXPECT_EQ(in.vertices, out.vertices);
  EXPECT_EQ(in.normals, out.normals);
  EXPECT_EQ(in.colours, out.colours);
  EXPECT_EQ(in.texture_coordinates, out.texture_coordinates);
  EXPECT_EQ(in.sigma, out.sigma);
  EXPECT_EQ(in.triangles, out.triangles);
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".tmp"));
}

TEST(Ply, AsciiPolygonsBecomeFansAndUnknownElementsAreSkipped) {
  const TemporaryFolder folder;
  const auto path = plyFile(folder,
                            "ply\nformat ascii 1.0\nelement camera 1\nproperty float f\nelement vertex 4\n"
                            "property double x\nproperty double y\nproperty double z\nproperty int flag\n"
                            "element face 1\nproperty list uchar int vertex_index\nend_header\n"
                            "7\n0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 0 1\n4 0 1 2 3\n");
  const Mesh mesh = readPly(path);
  ASSERT_EQ(mesh.vertices.size(), 4u);
  ASSERT_EQ(mesh.triangles.size(), 2u);
  EXPECT_EQ(mesh.triangles[1], (std::array<std::uint32_t, 3>{0, 2, 3}));
}

TEST(Ply, AMeshInPartsGivesTheSameBytesAndLeavesNothingElse) {
  const TemporaryFolder folder;
  Mesh whole = square();
  whole.triangles = {{0, 1, 2}, {0, 2, 3}};
  writePly(folder.path() / "whole.ply", whole, {"in one"});
  Mesh first = whole, second = whole;
  const auto split = [](auto& low, auto& high) {
    if (low.empty()) return;
    low.resize(3);
    high.erase(high.begin(), high.begin() + 3);
  };
  split(first.vertices, second.vertices);
  split(first.normals, second.normals);
  split(first.colours, second.colours);
  split(first.texture_coordinates, second.texture_coordinates);
  split(first.sigma, second.sigma);
  first.triangles = {{0, 1, 2}};
  second.triangles = {{0, 2, 3}};
  {
    PlyParts ply(folder.path() / "parts.ply", {"in one"});
    ply.add(first);
    ply.add(second);
    ply.add(Mesh{});
    ply.commit();
    EXPECT_EQ(ply.vertices(), 4U);
    EXPECT_EQ(ply.triangles(), 2U);
  }
  EXPECT_EQ(test::readText(folder.path() / "parts.ply"), test::readText(folder.path() / "whole.ply"));
  { const PlyParts dropped(folder.path() / "dropped.ply", {}); }
  std::size_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) ++files;
  EXPECT_EQ(files, 2U);

  PlyParts ply(folder.path() / "parts.ply", {});
  ply.add(first);
  second.normals.clear();
  EXPECT_THROW(ply.add(second), std::invalid_argument);
}

TEST(Ply, BigEndianFilesAreRead) {
  const TemporaryFolder folder;
  std::string text =
      "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nend_header\n";
  text += std::string("\x3f\x80\0\0\x40\0\0\0\xc0\x40\0\0", 12);
  EXPECT_EQ(readPly(plyFile(folder, text)).vertices[0], Eigen::Vector3f(1, 2, -3));
}

TEST(Ply, RefusesWhatIsNoMeshWithTheFileAndThePlace) {
  const TemporaryFolder folder;
  EXPECT_THAT(plyRefusal(folder.path() / "absent.ply"), HasSubstr("absent.ply"));
  EXPECT_NE(plyRefusal(folder.path()), "");
  EXPECT_NE(plyRefusal(plyFile(folder, "")), "");
  EXPECT_THAT(plyRefusal(plyFile(folder, "solid cube\n")), HasSubstr("not a PLY"));
  EXPECT_THAT(plyRefusal(plyFile(folder,
                                 "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\n"
                                 "property float y\nproperty float z\nend_header\n1 2 3\n")),
              HasSubstr("announces"));
  EXPECT_THAT(
      plyRefusal(plyFile(folder,
                         "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                         "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                         "end_header\n1 2 3\n3 0 0 7\n")),
      HasSubstr("face 0"));
  EXPECT_THAT(
      plyRefusal(plyFile(folder,
                         "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                         "property float z\nend_header\n1 nan 3\n")),
      HasSubstr("finite"));
}

TEST(Ply, AFileCutAnywhereIsRefusedNotCrashed) {
  const TemporaryFolder folder;
  const auto whole = folder.path() / "square.ply";
  writePly(whole, square());
  const std::string bytes = test::readText(whole);
  for (std::size_t n = 0; n < bytes.size(); n += 3)
    EXPECT_NE(plyRefusal(plyFile(folder, bytes.substr(0, n))), "") << "cut at byte " << n;
}

TEST(Ply, ReadsTheRealPavlopetriSurface) {
  FATHOM_REQUIRE_DATA("pavlopetri/chamber3.ply");
  const Mesh mesh = readPly(test::dataFile("pavlopetri/chamber3.ply"));
  EXPECT_EQ(mesh.vertices.size(), 32628u);
  EXPECT_EQ(mesh.triangles.size(), 63706u);
  EXPECT_EQ(mesh.texture_coordinates.size(), mesh.vertices.size());
}

namespace fs = std::filesystem;

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
