#include "recon/geometry/ply_reader.hpp"
#include "recon/geometry/ply_writer.hpp"

#include <gtest/gtest.h>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom {
namespace {

using test::TemporaryFolder;

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
  EXPECT_NE(plyRefusal(folder.path() / "absent.ply").find("absent.ply"), std::string::npos);
  EXPECT_NE(plyRefusal(folder.path()), "");
  EXPECT_NE(plyRefusal(plyFile(folder, "")), "");
  EXPECT_NE(plyRefusal(plyFile(folder, "solid cube\n")).find("not a PLY"), std::string::npos);
  EXPECT_NE(plyRefusal(plyFile(folder,
                               "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\n"
                               "property float y\nproperty float z\nend_header\n1 2 3\n"))
                .find("announces"),
            std::string::npos);
  EXPECT_NE(plyRefusal(plyFile(folder,
                               "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                               "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                               "end_header\n1 2 3\n3 0 0 7\n"))
                .find("face 0"),
            std::string::npos);
  EXPECT_NE(plyRefusal(plyFile(folder,
                               "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                               "property float z\nend_header\n1 nan 3\n"))
                .find("finite"),
            std::string::npos);
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

}  // namespace
}  // namespace fathom
