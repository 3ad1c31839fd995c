#include <gtest/gtest.h>
#include <httplib.h>
// The resolver's header, which httplib brings, takes a name that Eigen uses.
#undef _res

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "realtime/kernel/input_error.hpp"
#include "recon/viewer/served_folder.hpp"
#include "recon/viewer/view_server.hpp"

namespace fathom::viewer {
namespace {

namespace fs = std::filesystem;

class ViewServerTest : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("view_server_test_" + std::to_string(getpid()));
    write("secret.txt", "not for the browser");
    write("page/index.html", "<html>page</html>");
    write("mission/topside/scene.json",
          R"({"format":1,"tileset":"tiles/tileset.json","image_folder":"../img"})");
    write("mission/topside/tiles/0/0_0.glb", "0123456789");
    write("mission/img/PR_1_LC16.tif", "image");
  }
  void TearDown() override { fs::remove_all(root_); }
  void write(const fs::path& name, const std::string& text) const {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name, std::ios::binary) << text;
  }
  [[nodiscard]] ServedDive dive() const { return findDive(root_ / "mission", root_ / "page"); }
  fs::path root_;
};

TEST_F(ViewServerTest, APathCannotLeaveTheFolder) {
  const fs::path folder = root_ / "mission";
  EXPECT_TRUE(fileInside(folder, "topside/scene.json"));
  EXPECT_TRUE(fileInside(folder, "./img/PR_1_LC16.tif"));
  const std::string absolute = (root_ / "secret.txt").string();
  for (const std::string_view path :
       {std::string_view("../secret.txt"), std::string_view("topside/../../secret.txt"),
        std::string_view("topside/../img/PR_1_LC16.tif"), std::string_view(absolute), std::string_view(""),
        std::string_view("topside"), std::string_view("..\\secret.txt"), std::string_view("img/\0.tif", 9),
        std::string_view("img/absent.tif")})
    EXPECT_FALSE(fileInside(folder, path)) << path;
}

TEST_F(ViewServerTest, OnlyPagesOfThisMachineAreAnswered) {
  for (const char* host : {"127.0.0.1", "127.0.0.1:8090", "localhost:1", "[::1]:8090"})
    EXPECT_TRUE(namesThisMachine(host)) << host;
  for (const char* host :
       {"", "evil.example", "127.0.0.1.evil.example:80", "localhost.evil.example", "[::2]:1"})
    EXPECT_FALSE(namesThisMachine(host)) << host;
  const ViewServer server(dive(), 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/", {{"Host", "evil.example"}})->status, 403);
}

TEST_F(ViewServerTest, PageDiveAndImagesAreServedEachFromItsFolder) {
  const ViewServer server(dive(), 0);
  httplib::Client client("127.0.0.1", server.port());
  const auto page = client.Get("/");
  EXPECT_EQ(page->body, "<html>page</html>");
  EXPECT_EQ(page->get_header_value("Content-Type"), "text/html; charset=utf-8");
  const auto view = nlohmann::json::parse(client.Get("/view.json")->body);
  EXPECT_EQ(client.Get("/" + view["dive"].get<std::string>() + "tiles/0/0_0.glb")->body, "0123456789");
  EXPECT_EQ(client.Get("/" + view["images"].get<std::string>() + "PR_1_LC16.tif")->body, "image");
  EXPECT_EQ(client.Get("/dive/absent.json")->status, 404);
  EXPECT_EQ(client.Get("/dive/")->status, 404);
  EXPECT_EQ(client.Get("/dive/..%2f..%2fsecret.txt")->status, 404);
  EXPECT_EQ(client.Get("/dive/../../secret.txt")->status, 404);
  EXPECT_EQ(client.Post("/dive/scene.json", "x", "text/plain")->status, 404);
}

TEST_F(ViewServerTest, PartsOfAFileAreServed) {
  std::string large(300'000, '\0');
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>(i * 7 % 251);
  write("mission/topside/layers/slope.tif", large);
  const ViewServer server(dive(), 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/dive/layers/slope.tif")->body, large);
  const auto part = client.Get("/dive/layers/slope.tif", {httplib::make_range_header({{65'000, 199'999}})});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, large.substr(65'000, 135'000));
  const auto tail = client.Get("/dive/layers/slope.tif", {httplib::make_range_header({{262'144, 327'679}})});
  EXPECT_EQ(tail->status, 206);
  EXPECT_EQ(tail->body, large.substr(262'144)) << "a range is cut at the file's end";
  EXPECT_EQ(client.Get("/dive/layers/slope.tif", {httplib::make_range_header({{262'144, -1}})})->body,
            large.substr(262'144));
  EXPECT_EQ(client.Get("/dive/layers/slope.tif", {{"Range", "bytes=-1000"}})->body, large.substr(299'000));
  EXPECT_EQ(client.Get("/dive/layers/slope.tif", {httplib::make_range_header({{300'000, 300'010}})})->status,
            416);
}

TEST_F(ViewServerTest, AFolderWithoutADiveIsNamed) {
  try {
    (void)findDive(root_ / "page", root_ / "page");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("holds no scene.json"), std::string::npos);
  }
  write("mission/topside/scene.json", "{\"format\":1,");
  EXPECT_THROW((void)findDive(root_ / "mission", root_ / "page"), InputError);
  EXPECT_THROW((void)findDive(root_ / "mission", root_ / "absent"), InputError);
}

}  // namespace
}  // namespace fathom::viewer
