#include "telemetry/web/page_server.hpp"

#include <gtest/gtest.h>
#include <httplib.h>
// The resolver's header, which httplib brings, takes a name that Eigen uses.
#undef _res

#include <atomic>
#include <fstream>

#include "realtime/base/input_error.hpp"
#include "telemetry/web/access.hpp"
#include "telemetry/web/served_folder.hpp"
#include "tests/support/test_data.hpp"
#include "tests/web/raw_client.hpp"

namespace fathom::web {
namespace {

namespace fs = std::filesystem;
using test::answerTo;

class Pages : public testing::Test {
 protected:
  void SetUp() override {
    for (std::size_t i = 0; i < large_.size(); ++i) large_[i] = static_cast<char>(i * 7 % 251);
    write("secret.txt", "not for the browser");
    write("page/index.html", "<html>page</html>");
    write("page/parts/large.tif", large_);
    write("page/parts/empty.css", "");
  }
  void write(const fs::path& name, const std::string& text) const {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name, std::ios::binary) << text;
  }
  [[nodiscard]] PageServer serve(PageServerConfig config = {}) const {
    config.page = pageFolder(root_ / "page", "test");
    config.option = "--port";
    Routes routes;
    routes.post("/api/echo", [this](const HttpRequest& request) {
      ++echoed_;
      return answer(request.body, "text/plain");
    });
    return PageServer(config, std::move(routes));
  }
  test::TemporaryFolder scratch_;
  fs::path root_ = scratch_.path();
  std::string large_ = std::string(300'000, '\0');
  mutable std::atomic<int> echoed_ = 0;
};

// A page of another site can make a browser post any body, but neither the page's header nor another method
// to choose: no request may hide in the body of one that was refused.
TEST_F(Pages, NoRequestHidesInTheBodyOfARefusedOne) {
  PageServerConfig config;
  config.max_body_bytes = 100'000;
  const PageServer server = serve(config);
  const std::string hidden =
      "POST /api/echo HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Fathom: page\r\nContent-Length: 6\r\n\r\nsigned";
  for (const std::string& path : {std::string("/api/echo"), std::string("/absent")})
    for (const std::size_t whole : {std::size_t{0}, std::size_t{4096}, std::size_t{8192}}) {
      const auto head = [&](std::size_t length) {
        return "POST " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: keep-alive\r\nContent-Length: " +
               std::to_string(length) + "\r\n\r\n";
      };
      const std::size_t ahead = head(whole + 100).size(), filler = whole > ahead ? whole - ahead : 0;
      const std::string answer =
          answerTo(server.port(), head(filler + hidden.size()) + std::string(filler, 'x') + hidden);
      EXPECT_NE(answer.find("403"), std::string::npos) << whole;
      EXPECT_EQ(answer.find("signed"), std::string::npos) << whole;
      EXPECT_EQ(answer.find("HTTP/1.1", 8), std::string::npos) << "one answer";
      EXPECT_EQ(echoed_, 0);
    }
}

TEST_F(Pages, APathCannotLeaveTheFolder) {
  const fs::path folder = root_ / "page";
  EXPECT_TRUE(fileInside(folder, "index.html"));
  EXPECT_TRUE(fileInside(folder, "./parts/large.tif"));
  const std::string absolute = (root_ / "secret.txt").string();
  for (const std::string_view path :
       {std::string_view("../secret.txt"), std::string_view("parts/../../secret.txt"),
        std::string_view("parts/../index.html"), std::string_view(absolute), std::string_view(""),
        std::string_view("parts"), std::string_view("..\\secret.txt"), std::string_view("parts/\0.tif", 11),
        std::string_view("parts/absent.tif")})
    EXPECT_FALSE(fileInside(folder, path)) << path;
}

TEST_F(Pages, OnlyPagesOfThisMachineAreAnswered) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/")->status, 200);
  EXPECT_EQ(client.Get("/", {{"Host", "evil.example"}})->status, 403);
}

TEST_F(Pages, EveryAnswerForbidsKeepingFramingAndGuessing) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  for (const char* path : {"/", "/absent.js"}) {
    const auto answer = client.Get(path);
    EXPECT_EQ(answer->get_header_value("Cache-Control"), "no-store") << path;
    EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff") << path;
    EXPECT_EQ(answer->get_header_value("X-Frame-Options"), "DENY") << path;
    EXPECT_EQ(answer->get_header_value("Referrer-Policy"), "no-referrer") << path;
    EXPECT_EQ(answer->get_header_value("Cross-Origin-Resource-Policy"), "same-origin") << path;
    const std::string policy = answer->get_header_value("Content-Security-Policy");
    EXPECT_NE(policy.find("default-src 'none'; script-src 'self'; connect-src 'self' "), std::string::npos)
        << path;
    EXPECT_EQ(policy.find("unsafe"), std::string::npos) << path;
  }
}

TEST_F(Pages, FilesHaveTheirTypesAndNothingElseIsServed) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  const auto page = client.Get("/");
  EXPECT_EQ(page->body, "<html>page</html>");
  EXPECT_EQ(page->get_header_value("Content-Type"), "text/html; charset=utf-8");
  EXPECT_EQ(client.Get("/index.html")->body, page->body);
  EXPECT_EQ(client.Get("/parts/empty.css")->get_header_value("Content-Type"), "text/css");
  for (const char* path : {"/absent.json", "/parts/", "/..%2fsecret.txt", "/../secret.txt"})
    EXPECT_EQ(client.Get(path)->status, 404) << path;
}

TEST_F(Pages, PartsOfAFileAreServed) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/parts/large.tif")->body, large_);
  const auto part = client.Get("/parts/large.tif", {httplib::make_range_header({{65'000, 199'999}})});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, large_.substr(65'000, 135'000));
  const auto tail = client.Get("/parts/large.tif", {httplib::make_range_header({{262'144, 327'679}})});
  EXPECT_EQ(tail->status, 206);
  EXPECT_EQ(tail->body, large_.substr(262'144)) << "a range is cut at the file's end";
  EXPECT_EQ(client.Get("/parts/large.tif", {httplib::make_range_header({{262'144, -1}})})->body,
            large_.substr(262'144));
  EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", "bytes=-1000"}})->body, large_.substr(299'000));
  EXPECT_EQ(part->get_header_value("Content-Range"), "bytes 65000-199999/300000");
  for (const char* beyond : {"bytes=300000-300010", "bytes=300000-", "bytes=-0"})
    EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", beyond}})->status, 416) << beyond;
  for (const char* none :
       {"bytes=5-4", "bytes=a-b", "bytes=-", "lines=1-2", "bytes=0-1,5-6", "bytes=99999999999999999999-1"})
    EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", none}})->body.size(), large_.size()) << none;
  EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", "bytes=-999999"}})->body, large_);
  EXPECT_EQ(client.Get("/parts/empty.css", {{"Range", "bytes=0-"}})->status, 416);
  const auto head = client.Head("/parts/large.tif");
  EXPECT_EQ(head->get_header_value("Content-Length"), "300000");
  EXPECT_EQ(head->body, "");
}

TEST_F(Pages, WhatIsPostedNeedsThePagesHeaderAndStaysInItsBounds) {
  PageServerConfig config;
  config.max_body_bytes = 8;
  const PageServer server = serve(config);
  httplib::Client client("127.0.0.1", server.port());
  const httplib::Headers page{{kPageHeader, "page"}};
  EXPECT_EQ(client.Post("/api/echo", "short", "text/plain")->status, 403);
  EXPECT_EQ(client.Post("/api/echo", page, "short", "text/plain")->body, "short");
  EXPECT_EQ(client.Post("/api/echo", page, "much too long", "text/plain")->status, 413);
  EXPECT_EQ(client.Post("/index.html", page, "x", "text/plain")->status, 404);
}

TEST_F(Pages, WhatCannotBeServedIsNamed) {
  EXPECT_THROW((void)pageFolder(root_ / "absent", "test"), InputError);
  const PageServer server = serve();
  PageServerConfig same;
  same.port = server.port();
  EXPECT_THROW((void)serve(same), InputError);
}

}  // namespace
}  // namespace fathom::web
