#include "recon/topside/viewer/dive_server.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <nlohmann/json.hpp>

#include "tests/support/http_client.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

class DiveServer : public testing::Test {
 protected:
  void SetUp() override {
    write("secret.txt", "not for the browser");
    write("page/index.html", "<html>page</html>");
    write("mission/topside/scene.json",
          R"({"format":1,"tileset":"tiles/tileset.json","image_folder":"../img"})");
    write("mission/topside/tiles/0/0_0.glb", "0123456789");
    write("mission/img/PR_1_LC16.tif", "image");
  }
  void write(const fs::path& name, const std::string& text) const { test::writeText(root_ / name, text); }
  test::TemporaryFolder scratch_;
  fs::path root_ = scratch_.path();
};

TEST_F(DiveServer, PageDiveAndImagesAreServedEachFromItsFolder) {
  const web::PageServer server = serveDive(findDive(root_ / "mission"), root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/")->body, "<html>page</html>");
  const auto view = nlohmann::json::parse(client.Get("/view.json")->body);
  EXPECT_EQ(client.Get("/" + view["dive"].get<std::string>() + "tiles/0/0_0.glb")->body, "0123456789");
  EXPECT_EQ(client.Get("/" + view["images"].get<std::string>() + "PR_1_LC16.tif")->body, "image");
  EXPECT_EQ(client.Get("/dive/absent.json")->status, 404);
  EXPECT_EQ(client.Get("/dive/")->status, 404);
  EXPECT_EQ(client.Get("/dive/..%2f..%2fsecret.txt")->status, 404);
  EXPECT_EQ(client.Get("/dive/../../secret.txt")->status, 404);
  EXPECT_EQ(client.Post("/dive/scene.json", "x", "text/plain")->status, 403);
}

TEST_F(DiveServer, ProjectionsOfEpsgCodesAreServed) {
  const web::PageServer server = serveDive(findDive(root_ / "mission"), root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/crs/28356")->body, "+proj=utm +zone=56 +south +ellps=GRS80 +units=m +no_defs");
  for (const char* none : {"/crs/4326", "/crs/999999", "/crs/1", "/crs/28356x"})
    EXPECT_EQ(client.Get(none)->status, 404) << none;
}

TEST_F(DiveServer, ImagesAreServedFromWhereverTheSceneSaysAndNothingAroundThem) {
  write("elsewhere/deep/results/scene.json",
        R"({"format":1,"tileset":"tiles/tileset.json","image_folder":"../../../mission/img"})");
  const web::PageServer server = serveDive(findDive(root_ / "elsewhere/deep/results"), root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(nlohmann::json::parse(client.Get("/view.json")->body)["images"], "images/");
  EXPECT_EQ(client.Get("/images/PR_1_LC16.tif")->body, "image");
  for (const char* path :
       {"/images/../../secret.txt", "/images/..%2f..%2fsecret.txt", "/images/%2e%2e/%2e%2e/secret.txt",
        "/images//../topside/scene.json", "/images/..%2ftopside%2fscene.json", "/images/"})
    EXPECT_EQ(client.Get(path)->status, 404) << path;
}

TEST_F(DiveServer, OfTheImageFolderPicturesAloneAreServedWhateverFolderItIs) {
  write("home/.ssh/id_rsa", "secret");
  write("home/notes.txt", "secret");
  write("home/page.svg", "<svg onload='1'/>");
  write("home/PICTURE.PNG", "png");
  fs::create_symlink(root_ / "home/.ssh/id_rsa", root_ / "home/key.tif");
  fs::create_symlink(root_ / "mission/img/PR_1_LC16.tif", root_ / "home/linked.tif");
  ASSERT_EQ(::mkfifo((root_ / "home/pipe.tif").c_str(), 0600), 0);
  write("mission/topside/scene.json", R"({"format":1,"image_folder":")" + (root_ / "home").string() + "\"}");
  const web::PageServer server = serveDive(findDive(root_ / "mission"), root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/images/PICTURE.PNG")->body, "png");
  EXPECT_EQ(client.Get("/images/linked.tif")->body, "image");
  for (const char* path : {"/images/.ssh/id_rsa", "/images/notes.txt", "/images/page.svg", "/images/key.tif",
                           "/images/pipe.tif"})
    EXPECT_EQ(client.Get(path)->status, 404) << path;
}

TEST_F(DiveServer, NoFileOfADiveRunsInTheBrowser) {
  for (const char* name : {"report.html", "a.svg", "a.js", "a.HTM", "a.xhtml", "a.css"})
    write(std::string("mission/topside/") + name, "<script>1</script>");
  const web::PageServer server = serveDive(findDive(root_ / "mission"), root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  for (const char* path :
       {"/dive/report.html", "/dive/a.svg", "/dive/a.js", "/dive/a.HTM", "/dive/a.xhtml", "/dive/a.css",
        "/dive/scene.json", "/dive/tiles/0/0_0.glb", "/images/PR_1_LC16.tif"}) {
    const auto got = client.Get(path);
    EXPECT_EQ(got->status, 200) << path;
    EXPECT_EQ(got->get_header_value("Content-Security-Policy"), "default-src 'none'; sandbox") << path;
    const std::string type = got->get_header_value("Content-Type");
    for (const char* active : {"html", "svg", "script", "css"})
      EXPECT_EQ(type.find(active), std::string::npos) << path << ' ' << type;
  }
  EXPECT_EQ(client.Get("/dive/report.html")->get_header_value("Content-Disposition"), "attachment");
  EXPECT_EQ(client.Get("/dive/scene.json")->get_header_value("Content-Disposition"), "");
  const std::string policy = client.Get("/")->get_header_value("Content-Security-Policy");
  EXPECT_EQ(policy.find("unsafe-inline"), std::string::npos);
  EXPECT_EQ(policy.find("'unsafe-eval'"), std::string::npos);
}

TEST_F(DiveServer, ADiveWhoseImagesAreNotThereIsServedWithoutThem) {
  fs::rename(root_ / "mission/topside", root_ / "moved");
  const ServedDive dive = findDive(root_ / "moved");
  EXPECT_FALSE(dive.hasImages());
  const web::PageServer server = serveDive(dive, root_ / "page", 0);
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_TRUE(nlohmann::json::parse(client.Get("/view.json")->body)["images"].is_null());
  EXPECT_EQ(client.Get("/dive/tiles/0/0_0.glb")->body, "0123456789");
  EXPECT_EQ(client.Get("/images/PR_1_LC16.tif")->status, 404);
}

TEST_F(DiveServer, AFolderWithoutADiveIsNamed) {
  EXPECT_NE(test::refusal([&] { (void)findDive(root_ / "page"); }).find("holds no scene.json"),
            std::string::npos);
  write("mission/topside/scene.json", "{\"format\":1,");
  EXPECT_THROW((void)findDive(root_ / "mission"), InputError);
}

}  // namespace
}  // namespace fathom::topside
